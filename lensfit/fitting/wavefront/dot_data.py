"""All dots of all photographs of one focal length, as arrays of the wavefront fit."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.fitting.adjust import fitted_depths_mm
from lensfit.fitting.breathing import inverse_pupil_magnification
from lensfit.fitting.chart_view import Widths
from lensfit.fitting.fall_off.illumination import FallOffFit
from lensfit.fitting.wavefront.dot_arrays import Broad, Dots, FocusRange
from lensfit.fitting.wavefront.dot_patches import (
    DotPhotograph,
    are_broad,
    are_of_one_setting,
    centroids_mm,
    diameters_mm,
    own_cells,
    usable_cells,
)
from lensfit.fitting.wavefront.known_dots import Reference, dots_of
from lensfit.fitting.wavefront.parameters import Scale
from lensfit.fitting.wavefront.waves import Transfer, transfers_of
from lensfit.optics.paraxial import FirstOrder, first_order_of, rim_sine
from lensfit.optics.spectrum import Bands

_NEAREST_FOCUS, _USUAL_FOCUS = 2.0, 20.0
"""In principal distances; at two an object is imaged at its own size."""
WIDE_OPEN = 1.02
"""Up to this ratio to the widest f-number the blades do not cut the pupil."""


class FocusGroup(NamedTuple):
    """Takes that share focus and chart, so that one defocus serves them."""

    focus_distance_mm: float | None
    target_distance_mm: float | None
    take: str
    """Name of the take, where nobody stated how far the chart was; else empty."""


class Beam(NamedTuple):
    """The beam through a stop.

    Attributes
    ----------
    ratio : Its width over what the f-number says.
    deviation : Standard deviation of that, as a share.
    """

    ratio: float
    deviation: float


OF_F_NUMBER = Beam(1.0, 0.0)


class PhotographedFallOff(NamedTuple):
    """Fall-off at a stated f-number, of a state of this principal distance."""

    f_number: float
    principal_distance_mm: float
    fit: FallOffFit


@dataclass(frozen=True, eq=False)
class DotData:
    """All dots of all photographs.

    Attributes
    ----------
    dots : Constants of the model.
    light, valid, clipped : As in `DotImages`.
    observed_mm : Centroid of each channel from the corner of its patch.
    diameter_mm : Of the disc of the same second moment, pixels taken off.
    read_noise : Of a cell, per dot and channel.
    take : Index into `photographs`.
    colour : Whether red and blue were photographed.
    scale : Constants of the model.
    wavelengths_nm : Of the channels, their bands as wide as usual.
    groups, f_numbers : What `Dots.group` and `Dots.stop` count.
    reference_distance_mm : For which the aberrations hold, from the sensor.
    focus : Focus distances of all photographs.
    first_order : At the reference state.
    beam : How wide the beam through a stop is.
    fall_offs : How the light falls off over the frame, as far as it was photographed.
    """

    photographs: tuple[DotPhotograph, ...]
    dots: Dots
    light: Float[np.ndarray, "dots 3 rows columns"]
    valid: Bool[np.ndarray, "dots 3 rows columns"]
    clipped: Bool[np.ndarray, "dots 3 rows columns"]
    observed_mm: Float[np.ndarray, "dots 3 2"]
    diameter_mm: Float[np.ndarray, " dots"]
    read_noise: Float[np.ndarray, "dots 3"]
    take: Int[np.ndarray, " dots"]
    colour: bool
    scale: Scale
    wavelengths_nm: Float[np.ndarray, "3 wavelengths"]
    groups: tuple[FocusGroup, ...]
    f_numbers: tuple[float, ...]
    reference_distance_mm: float
    focus: FocusRange
    first_order: FirstOrder
    beam: Beam = OF_F_NUMBER
    fall_offs: tuple[PhotographedFallOff, ...] = ()

    @property
    def widths(self) -> Widths:
        """Standard deviations of what is stated about the shoot."""
        return self.photographs[0].take.widths

    @property
    def of_one_setting(self) -> bool:
        """Whether all photographs have one f-number and one focus distance."""
        return are_of_one_setting(self.photographs)

    @property
    def shows_focusing(self) -> bool:
        """Whether photographs at several focus distances show what focusing changes."""
        return bool(np.any(self.dots.focus))

    @cached_property
    def transfer(self) -> Transfer | None:
        """Transfer functions of the discs of broad dots (`waves`); None for others."""
        if self.dots.broad is None:
            return None
        return self._transfers(self.dots.broad, sharp=False)

    @cached_property
    def sharp_transfer(self) -> Transfer | None:
        """The same with their sharpest detail."""
        if self.dots.broad is None:
            return None
        return self._transfers(self.dots.broad, sharp=True)

    def _transfers(self, broad: Broad, *, sharp: bool) -> Transfer:
        seen = [one.take.observations.markers for one in self.photographs]
        markers = [seen[k] for k in self.take]
        cells = self.light.shape[-1]
        return transfers_of(broad, self.dots.cell_mm, cells, markers, sharp=sharp)


def dot_data_of(photographs: list[DotPhotograph], bands: Bands) -> DotData:
    """Arrays of all dots; every take states its f-number."""
    f_numbers = sorted({s.f_number for s in photographs})
    groups = tuple(dict.fromkeys(_group(s) for s in photographs))
    settings = [
        (groups.index(_group(one)), f_numbers.index(one.f_number))
        for one in photographs
    ]
    known = _reference(photographs)
    return _dot_data(photographs, known, groups, tuple(f_numbers), settings, bands)


def unfitted_dot_data(
    dot_data: DotData, photographs: list[DotPhotograph], bands: Bands
) -> DotData | None:
    """Arrays of photographs at focus distances of others whose wavefront is known.

    A stop that is not among theirs is as wide as its f-number says.

    Returns
    -------
    None where no photograph is at such a focus distance.
    """
    settings, kept = [], []
    for one in photographs:
        focus_mm = one.take.focus_distance_mm
        groups = [
            k for k, g in enumerate(dot_data.groups) if g.focus_distance_mm == focus_mm
        ]
        if groups and focus_mm is not None:
            known = one.f_number in dot_data.f_numbers
            stop = dot_data.f_numbers.index(one.f_number) if known else 0
            settings.append((groups[0], stop))
            kept.append(one)
    if not kept:
        return None
    known = _reference(list(dot_data.photographs))
    shared = dot_data.groups, dot_data.f_numbers
    found = _dot_data(kept, known, *shared, settings, bands)
    return widen_beam(found, dot_data.beam)


def widen_beam(dot_data: DotData, beam: Beam) -> DotData:
    """The same with such a beam instead of the one that the f-number says."""
    scale = dot_data.scale
    sine = scale.reference_sine * (beam.ratio / dot_data.beam.ratio)
    return replace(dot_data, scale=scale._replace(reference_sine=sine), beam=beam)


def _dot_data(
    photographs: list[DotPhotograph],
    known: Reference,
    groups: tuple[FocusGroup, ...],
    f_numbers: tuple[float, ...],
    settings: list[tuple[int, int]],
    bands: Bands,
) -> DotData:
    """Arrays of all dots.

    Parameters
    ----------
    settings : Of every photograph, which of the groups and of the f-numbers it has.
    """
    sine, broad = _rim_sine(known, f_numbers[0]), are_broad(photographs)
    rows = []
    for one, (group, stop) in zip(photographs, settings, strict=True):
        radius = _rim_sine(known, one.f_number) / sine
        rows.append(dots_of(one, group, stop, radius, known, bands, broad=broad))
    cut = [s.dot_images for s in photographs]
    counts = [len(c.marks) for c in cut]
    return DotData(
        photographs=tuple(photographs),
        dots=jax.tree.map(lambda *parts: np.concatenate(parts), *rows),
        light=np.concatenate([c.light for c in cut]),
        valid=np.concatenate(
            [_valid(s, r.broad) for s, r in zip(photographs, rows, strict=True)]
        ),
        clipped=np.concatenate([c.clipped for c in cut]),
        observed_mm=np.concatenate(
            [_observed_mm(s, r.broad) for s, r in zip(photographs, rows, strict=True)]
        ),
        diameter_mm=np.concatenate([diameters_mm(s) for s in photographs]),
        read_noise=np.repeat([c.read_noise for c in cut], counts, axis=0),
        take=np.repeat(np.arange(len(photographs)), counts),
        colour=any(c.channels == 3 for c in cut),
        scale=Scale(
            jnp.asarray(photographs[0].take.corner_mm),
            jnp.asarray(sine),
            jnp.asarray(known.principal_distance_mm),
        ),
        wavelengths_nm=np.asarray(bands.wavelengths_nm),
        groups=groups,
        f_numbers=f_numbers,
        reference_distance_mm=known.distance_mm,
        focus=known.focus,
        first_order=known.first_order,
    )


def _rim_sine(known: Reference, f_number: float) -> float:
    distance_mm = jnp.asarray(known.distance_mm)
    return float(rim_sine(known.first_order, jnp.asarray(f_number), distance_mm))


def _valid(
    photograph: DotPhotograph, broad: Broad | None
) -> Bool[np.ndarray, "dots 3 rows columns"]:
    """Cells to use; of broad dots none that lie nearer to a neighbouring dot."""
    usable = usable_cells(photograph.dot_images)
    if broad is None or photograph.take.observations.are_edges:
        return usable
    return usable & own_cells(photograph, broad.neighbour_offsets_mm)[:, None]


def _observed_mm(
    photograph: DotPhotograph, broad: Broad | None
) -> Float[np.ndarray, "dots 3 2"]:
    """Of every detected point, or of the rim that is shown, from the patch's corner."""
    observed_mm = centroids_mm(photograph.take, photograph.dot_images)
    return observed_mm if broad is None else observed_mm - broad.rim_mm[:, None]


def select_dots(dot_data: DotData, rows: Int[np.ndarray, " some"]) -> DotData:
    """Only some of the dots."""
    parts = ("light", "valid", "clipped", "observed_mm", "diameter_mm")
    parts += ("read_noise", "take")
    return replace(
        dot_data,
        dots=jax.tree.map(lambda a: a[rows], dot_data.dots),
        **{name: getattr(dot_data, name)[rows] for name in parts},
    )


def rows_spread_over_takes(dot_data: DotData, most: int) -> Int[np.ndarray, " rows"]:
    """Rows of up to `most` dots of every take, as far apart as possible."""
    field_mm = np.asarray(dot_data.dots.field_mm)
    return np.concatenate(
        [
            farthest_point_rows(field_mm, np.flatnonzero(dot_data.take == k), most)
            for k in range(len(dot_data.photographs))
        ]
    )


def farthest_point_rows(
    points: Float[np.ndarray, "points 2"], among: Int[np.ndarray, " some"], most: int
) -> Int[np.ndarray, " chosen"]:
    """Up to `most` of `among`, each as far as possible from those before; sorted."""
    points = points[among]
    if len(points) <= most:
        return among
    first = int(np.argmax(np.sum((points - points.mean(0)) ** 2, -1)))
    found = [first]
    distance = np.sum((points - points[first]) ** 2, -1)
    while len(found) < most:
        found.append(int(np.argmax(distance)))
        away = np.sum((points - points[found[-1]]) ** 2, -1)
        distance = np.minimum(distance, away)
    return among[np.sort(found)]


def _reference(photographs: list[DotPhotograph]) -> Reference:
    """The state nearest to being in focus, and the distance of its chart."""
    nearest = _nearest_to_focus(photographs)
    offset = nearest.pupil_offset_mm
    c = float(nearest.distortion.principal_distance_mm)
    depth_scale = _depth_scale(photographs, c)
    depth_mm = depth_scale * _depth_mm(nearest)
    distance = nearest.take.target_distance_mm or depth_mm + offset
    m_p = 1 / _inverse_pupil_magnification(photographs, nearest)
    thin = first_order_of(*(jnp.asarray(n) for n in (c, m_p, offset, distance)))
    focus = FocusRange.of(
        nearest.take.focus_distance_mm,
        (one.take.focus_distance_mm for one in photographs),
    )
    return Reference(c, thin, distance, focus, depth_scale)


def _inverse_pupil_magnification(
    photographs: list[DotPhotograph], nearest: DotPhotograph
) -> float:
    """1 / m_p, from breathing; never exactly 0."""
    found = {
        one.take.focus_distance_mm: (
            float(one.distortion.principal_distance_mm),
            1 / (one.take.focus_distance_mm - one.pupil_offset_mm),
        )
        for one in photographs
        if one.take.focus_distance_mm
    }
    statements = nearest.geometry.adjustment.statements
    if not found or statements is None:
        return 1.0
    known, facts = np.array(list(found.values())), statements.facts
    inverse = inverse_pupil_magnification(
        known[:, 0], known[:, 1], facts.focal_length_mm, facts.widths.focal_length
    )
    return inverse or np.finfo(float).tiny


def _depth_scale(
    photographs: list[DotPhotograph], principal_distance_mm: float
) -> float:
    """Factor on all depths: where nobody stated a distance, and a chart would be nearer
    than a lens can be focused, its pitch is not a length in mm."""
    if any(one.take.target_distance_mm for one in photographs):
        return 1.0
    nearest = min(map(_depth_mm, photographs)) / principal_distance_mm
    return 1.0 if nearest >= _NEAREST_FOCUS else _USUAL_FOCUS / nearest


def _nearest_to_focus(photographs: list[DotPhotograph]) -> DotPhotograph:
    def dioptres_off(one: DotPhotograph) -> float:
        take = one.take
        if not take.target_distance_mm or not take.focus_distance_mm:
            return np.inf
        return abs(1 / take.target_distance_mm - 1 / take.focus_distance_mm)

    return min(photographs, key=lambda one: (dioptres_off(one), one.dot_images.cell_px))


def _group(photograph: DotPhotograph) -> FocusGroup:
    take = photograph.take
    name = "" if take.target_distance_mm else take.name
    return FocusGroup(take.focus_distance_mm, take.target_distance_mm, name)


def _depth_mm(photograph: DotPhotograph) -> float:
    """From the entrance pupil to the chart, as the geometry has it."""
    return float(fitted_depths_mm(photograph.geometry.adjustment)[photograph.index])

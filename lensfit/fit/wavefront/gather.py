"""From fitted states and cutouts to the arrays of the wavefront fit.

The geometry says where on the lens' field every dot is, how large its hole is imaged,
and how far from the lens that part of the chart is; all of this is taken as known.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lensfit.detect.cutouts import Cutouts
from lensfit.fit.chief_ray import ChiefRayFit
from lensfit.fit.geometry import (
    Frame,
    View,
    board_point_mm,
    direction_of,
    lens_of,
    parts_of,
)
from lensfit.fit.parameters import Layout as GeometryLayout
from lensfit.fit.take import Take
from lensfit.fit.wavefront.dots import Dots
from lensfit.fit.wavefront.parameters import Scale
from lensfit.kernel.pixels import diffraction_variance_mm2
from lensfit.optics.depth import ObjectShift, object_shift
from lensfit.optics.distortion import Distortion, distorted_from_direction
from lensfit.optics.lateral import ChannelShift, channel_from_green
from lensfit.optics.paraxial import FirstOrder, rim_sine
from lensfit.optics.spectrum import Bands, chromatic_coordinate, lateral_at

LARGEST_HOLE_CELLS = 0.9
"""Up to this radius a Gaussian of the same variance stands for the hole to 1 %."""
WIDE_OPEN = 1.02
"""Up to this ratio to the widest f-number the blades are out of the way."""


class Group(NamedTuple):
    """Takes that share focus and chart, so that one defocus serves them."""

    focus_distance_mm: float | None
    target_distance_mm: float | None
    take: str
    """Name of the take, where nobody said how far the chart was; else empty."""


class Shown(NamedTuple):
    """One photograph with cutouts, and the geometry of its state."""

    take: Take
    cutouts: Cutouts
    geometry: ChiefRayFit
    distortion: Distortion
    colour: tuple[ChannelShift, ChannelShift] | None
    """Displacement of red and blue, as far as known."""
    index: int
    """Of the take within the geometry."""


@dataclass(frozen=True, eq=False)
class Gathered:
    """All dots of all photographs.

    Attributes
    ----------
    dots : Constants of the model.
    light, valid, clipped : As in `Cutouts`.
    observed_mm : Centroid of each channel from the corner of its cutout.
    diameter_mm : Of the disc of the same second moment, pixels taken off.
    read_noise : Of a cell, per dot and channel.
    take : Index into `shown`.
    colour : Whether red and blue were photographed.
    scale, chromatic : Constants of the model; chromatic coordinates of the channels.
    groups, f_numbers : What `Dots.group` and `Dots.stop` count.
    reference_distance_mm : For which the aberrations hold, from the sensor.
    first_order : At the reference state.
    """

    shown: tuple[Shown, ...]
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
    chromatic: Float[np.ndarray, "3 wavelengths"]
    groups: tuple[Group, ...]
    f_numbers: tuple[float, ...]
    reference_distance_mm: float
    first_order: FirstOrder


def gather(shown: list[Shown], bands: Bands) -> Gathered:
    """Arrays of all dots; every take states its f-number."""
    reference = _reference(shown)
    offset = _offset_mm(reference)
    distance = reference.take.target_distance_mm or _middle_distance_mm(reference)
    c = float(reference.distortion.principal_distance_mm)
    # The thin lens whose chief rays have this principal distance.
    first_order = FirstOrder(
        jnp.asarray(1 / (1 / c + 1 / (distance - offset))),
        jnp.asarray(1.0),
        jnp.asarray(offset),
    )
    f_numbers = sorted({_f_number(s) for s in shown})
    sines = [
        float(rim_sine(first_order, jnp.asarray(n), jnp.asarray(distance)))
        for n in f_numbers
    ]
    groups = tuple(dict.fromkeys(_group(s) for s in shown))
    scale = Scale(
        field_radius_mm=jnp.asarray(np.hypot(*reference.take.sensor_size_mm) / 2),
        reference_sine=jnp.asarray(sines[0]),
        principal_distance_mm=jnp.asarray(c),
    )
    rows = [
        _dots_of(s, groups, f_numbers, sines, c, first_order, distance, bands)
        for s in shown
    ]
    cut = [s.cutouts for s in shown]
    counts = [len(c.marks) for c in cut]
    return Gathered(
        shown=tuple(shown),
        dots=jax.tree.map(lambda *parts: np.concatenate(parts), *rows),
        light=np.concatenate([c.light for c in cut]),
        valid=np.concatenate([_three(c.valid, c) for c in cut]),
        clipped=np.concatenate([c.clipped for c in cut]),
        observed_mm=np.concatenate([_centroids_mm(s) for s in shown]),
        diameter_mm=np.concatenate([_diameters_mm(s) for s in shown]),
        read_noise=np.repeat([c.read_noise for c in cut], counts, axis=0),
        take=np.repeat(np.arange(len(shown)), counts),
        colour=any(c.channels == 3 for c in cut),
        scale=scale,
        chromatic=np.asarray(chromatic_coordinate(bands.wavelengths_nm)),
        groups=groups,
        f_numbers=tuple(f_numbers),
        reference_distance_mm=distance,
        first_order=first_order,
    )


def chosen(gathered: Gathered, rows: Int[np.ndarray, " some"]) -> Gathered:
    """Only some of the dots."""
    parts = ("light", "valid", "clipped", "observed_mm", "diameter_mm")
    parts += ("read_noise", "take")
    return replace(
        gathered,
        dots=jax.tree.map(lambda a: a[rows], gathered.dots),
        **{name: getattr(gathered, name)[rows] for name in parts},
    )


def spread_over_takes(gathered: Gathered, most: int) -> Int[np.ndarray, " rows"]:
    """Rows of up to `most` dots of every take, as far from each other as can be."""
    field_mm = np.asarray(gathered.dots.field_mm)
    return np.concatenate(
        [
            spread_out(field_mm, np.flatnonzero(gathered.take == k), most)
            for k in range(len(gathered.shown))
        ]
    )


def spread_out(
    points: Float[np.ndarray, "points 2"], among: Int[np.ndarray, " some"], most: int
) -> Int[np.ndarray, " chosen"]:
    """Up to `most` of `among`, each as far as can be from those before; sorted."""
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


def _three(valid: np.ndarray, cutouts: Cutouts) -> np.ndarray:
    """Cells to use of each channel: a grey photograph has only green."""
    channels = np.array([cutouts.channels == 3, True, cutouts.channels == 3])
    return valid[:, None] & channels[None, :, None, None]


def _f_number(shown: Shown) -> float:
    if shown.take.f_number is None:
        raise ValueError(f"the f-number of {shown.take.name} is not known")
    return shown.take.f_number


def _reference(shown: list[Shown]) -> Shown:
    """The take whose state the numbers refer to: nearest to being in focus."""

    def dioptres_off(one: Shown) -> float:
        take = one.take
        if not take.target_distance_mm or not take.focus_distance_mm:
            return np.inf
        return abs(1 / take.target_distance_mm - 1 / take.focus_distance_mm)

    return min(shown, key=lambda one: (dioptres_off(one), one.cutouts.cell_px))


def _group(shown: Shown) -> Group:
    take = shown.take
    name = "" if take.target_distance_mm else take.name
    return Group(take.focus_distance_mm, take.target_distance_mm, name)


def _offset_mm(shown: Shown) -> float:
    """Entrance pupil in front of the sensor, assumed as in the geometry."""
    return float(shown.distortion.principal_distance_mm)


def _middle_distance_mm(shown: Shown) -> float:
    return _fitted_depth_mm(shown.geometry, shown.index) + _offset_mm(shown)


def _fitted_depth_mm(geometry: ChiefRayFit, index: int) -> float:
    """From the entrance pupil to the middle of the board, as the geometry has it."""
    adjustment = geometry.adjustment
    layout = adjustment.layout
    local = adjustment.parameters[layout.shared :].reshape(-1, layout.local)[index]
    pose = local[layout.local_blocks["pose"]]
    return float(adjustment.stack.view.translation_mm[index][2] * (1 + pose[5]))


def _depth_factor(shown: Shown) -> float:
    """What corrects the geometry's depths.

    Blur moves centroids outward at some f-numbers (`aperture_shift`), which looks like
    a nearer board; the takes of that state and f-number whose distance was measured say
    by how much.
    """
    offset = _offset_mm(shown)
    ratios = [
        (take.target_distance_mm - offset) / _fitted_depth_mm(shown.geometry, k)
        for k, take in enumerate(shown.geometry.takes)
        if take.target_distance_mm and take.f_number == shown.take.f_number
    ]
    return float(np.median(ratios)) if ratios else 1.0


def _dots_of(
    shown: Shown,
    groups: tuple[Group, ...],
    f_numbers: list[float],
    sines: list[float],
    reference_c: float,
    first_order: FirstOrder,
    distance: float,
    bands: Bands,
) -> Dots:
    """Constants of the dots of one photograph."""
    adjustment, marks = shown.geometry.adjustment, shown.cutouts.marks
    count = len(marks)
    room = 1 << (count - 1).bit_length()
    board = adjustment.stack.board[shown.index][marks]
    shift, per_board = _seen(
        jnp.asarray(adjustment.parameters),
        jnp.asarray(shown.index),
        jnp.asarray(_depth_factor(shown)),
        jnp.asarray(np.pad(board, [(0, room - count), (0, 0)], mode="edge")),
        adjustment.stack.view,
        adjustment.layout,
        adjustment.frame,
        first_order,
        jnp.asarray(distance),
    )
    shift, per_board = jax.tree.map(lambda a: np.asarray(a)[:count], (shift, per_board))
    stop = f_numbers.index(_f_number(shown))
    c = float(shown.distortion.principal_distance_mm)
    radius = _hole_radius_mm(shown)
    observed = adjustment.stack.observed_mm[shown.index][marks]
    pitch = _pixel_mm(shown)
    return Dots(
        field_mm=observed - np.asarray(shown.distortion.principal_point_mm),
        magnified=np.full(count, c / reference_c),
        group=np.full(count, groups.index(_group(shown))),
        stop=np.full(count, stop),
        stop_radius=np.full(count, sines[stop] / sines[0]),
        blades=np.zeros(count),
        slope=np.asarray(shift.slope),
        pupil_per_sine_mm=np.asarray(shift.pupil_per_sine_mm),
        vergence=np.asarray(shift.vergence_per_mm),
        reference=np.asarray(shift.reference_per_mm),
        lateral_mm=_within_bands_mm(shown, observed, bands),
        variance_mm2=np.sum((per_board * radius) ** 2, (1, 2)) / 8
        + float(diffraction_variance_mm2(jnp.asarray(shown.take.f_number))),
        cell_mm=np.tile(pitch * shown.cutouts.cell_px, (count, 1)),
    )


def _within_bands_mm(shown: Shown, observed_mm: np.ndarray, bands: Bands) -> np.ndarray:
    """Wavelengths about their band's mean: (dots, 3, wavelengths, 2)."""
    wavelengths = bands.wavelengths_nm.shape[1]
    if shown.colour is None:
        return np.zeros((len(observed_mm), 3, wavelengths, 2))
    room = 1 << (len(observed_mm) - 1).bit_length()
    points = np.pad(observed_mm, [(0, room - len(observed_mm)), (0, 0)], mode="edge")
    centre = shown.distortion.principal_point_mm
    radius = shown.distortion.reference_radius_mm
    chromatic = chromatic_coordinate(bands.wavelengths_nm)
    red, blue = shown.colour
    moved = _lateral_mm(jnp.asarray(points), red, blue, centre, radius, chromatic)
    return np.asarray(moved)[: len(observed_mm)]


@jax.jit
def _lateral_mm(
    points: Array,
    red: ChannelShift,
    blue: ChannelShift,
    centre: Array,
    radius: Array,
    chromatic: Array,
) -> Array:
    means = jnp.mean(chromatic, 1)

    def one(point):
        to_red = channel_from_green(point, red, centre, radius) - point
        to_blue = channel_from_green(point, blue, centre, radius) - point
        of_channels = jax.vmap(lateral_at, (0, None, None, None))
        moved = of_channels(chromatic, to_red, to_blue, means)
        return moved - jnp.mean(moved, 1, keepdims=True)

    return jax.vmap(one)(points)


def hole_cells(shown: Shown) -> float:
    """Radius of the hole's image, in cells of its cutout."""
    stack, rows = shown.geometry.adjustment.stack, shown.cutouts.marks
    half_mm = np.asarray(stack.view.half_board_mm[shown.index])
    board = stack.board[shown.index][rows] * half_mm
    areas = [
        np.linalg.det(np.cov(points.T))
        for points in (stack.observed_mm[shown.index][rows], board)
    ]
    magnification = (areas[0] / areas[1]) ** 0.25
    cell_mm = float(np.mean(_pixel_mm(shown))) * shown.cutouts.cell_px
    return _hole_radius_mm(shown) * magnification / cell_mm


def _hole_radius_mm(shown: Shown) -> float:
    return float(shown.geometry.adjustment.radius_mm[shown.index])


def _pixel_mm(shown: Shown) -> np.ndarray:
    size = shown.take.observations.image_size_px
    return np.asarray(shown.take.sensor_size_mm) / np.asarray(size)


def _diameters_mm(shown: Shown) -> np.ndarray:
    """A pixel adds a twelfth of its square to the second moment of each axis."""
    diameter = shown.take.observations.diameter_px[shown.cutouts.marks]
    square = np.maximum(diameter**2 - 16 / 12, 0.0)
    return np.sqrt(square) * float(np.mean(_pixel_mm(shown)))


def _centroids_mm(shown: Shown) -> np.ndarray:
    """(dots, 3, 2): of every channel, from the corner of the cutout."""
    observations, cutouts = shown.take.observations, shown.cutouts
    green = observations.points_px[cutouts.marks]
    channels = observations.channel_points_px[:, cutouts.marks]
    channels = np.where(np.isfinite(channels), channels, green[None])
    from_corner = channels.transpose(1, 0, 2) - cutouts.corner_px[:, None]
    return from_corner * _pixel_mm(shown)


@partial(jax.jit, static_argnames=("layout",))
def _seen(
    parameters: Array,
    index: Array,
    factor: Array,
    board: Array,
    views: View,
    layout: GeometryLayout,
    frame: Frame,
    first_order: FirstOrder,
    reference_mm: Array,
) -> tuple[ObjectShift, Array]:
    """Of each mark: how far from the reference depth, and d sensor / d board mm.

    `factor` corrects depths (`_depth_factor`).
    """
    shared = parameters[: layout.shared]
    local = parameters[layout.shared :].reshape(-1, layout.local)[index]
    view = jax.tree.map(lambda a: a[index], views)
    parts = parts_of(shared, local, layout)
    lens = lens_of(parts, layout, frame)

    def ahead(mark):
        point = board_point_mm(mark, parts, view, layout)
        return direction_of(point, parts, view).at[2].multiply(factor)

    def landed(slope):
        return distorted_from_direction(jnp.append(slope, 1.0), lens)

    def slope_of(mark):
        direction = ahead(mark)
        return direction[:2] / direction[2]

    def one(mark):
        slope = slope_of(mark)
        per_slope = jax.jacfwd(landed)(slope)
        per_board = per_slope @ jax.jacfwd(slope_of)(mark) / view.half_board_mm[None]
        distance = ahead(mark)[2] + first_order.entrance_pupil_offset_mm
        shift = object_shift(slope, per_slope, first_order, reference_mm, distance)
        return shift, per_board

    return jax.vmap(one)(board)

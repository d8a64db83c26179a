"""What is known of the dots of one photograph before the wavefront fit.

The geometry says where on the lens' field every dot is, how large its hole is imaged,
and how far from the lens that part of the chart is; all of this is taken as known.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.detect.centroids import SMOOTHING_DARK_PX, windows_of
from lensfit.detect.corner_fit import half_width_px
from lensfit.fitting.adjust import fitted_depths_mm
from lensfit.fitting.geometry import (
    Frame,
    View,
    board_point_mm,
    direction_of,
    lens_of,
    parts_of,
)
from lensfit.fitting.parameters import Layout as GeometryLayout
from lensfit.fitting.wavefront.beside import NEIGHBOURS, beside_mm
from lensfit.fitting.wavefront.dot_aperture import Hole, hole_of, no_hole, soft_hole
from lensfit.fitting.wavefront.dot_patches import (
    Shown,
    diameters_mm,
    hole_radius_mm,
)
from lensfit.fitting.wavefront.dots import Aperture, Broad, Dots
from lensfit.fitting.wavefront.edges import bright_ahead
from lensfit.kernel.pixels import diffraction_variance_mm2
from lensfit.optics.depth import ObjectShift, object_shift
from lensfit.optics.distortion import Distortion, distorted_from_direction
from lensfit.optics.lateral import ChannelShift, channel_from_green
from lensfit.optics.paraxial import FirstOrder
from lensfit.optics.sections import Sections, log_squeeze, sections_of
from lensfit.optics.spectrum import Bands, chromatic_coordinate, lateral_at

_BATCH, _GREEN = 512, 1


class Reference(NamedTuple):
    """What the numbers of all dots refer to.

    Attributes
    ----------
    principal_distance_mm : Of the state nearest to being in focus.
    first_order : The thin lens with these chief rays.
    distance_mm : From the sensor, at which the aberrations hold.
    farther : What depths of the geometry are multiplied by (`gather`).
    """

    principal_distance_mm: float
    first_order: FirstOrder
    distance_mm: float
    farther: float = 1.0


def dots_of(
    shown: Shown,
    group: int,
    stop: int,
    stop_radius: float,
    reference: Reference,
    bands: Bands,
    *,
    broad: bool,
) -> Dots:
    """Constants of the dots of one photograph; see `Dots`.

    Parameters ---------- broad : Whether dots are discs (`waves`) rather than places of
    rays (`dot_aperture`).
    """
    adjustment, marks = shown.geometry.adjustment, shown.cutouts.marks
    count = len(marks)
    board = adjustment.stack.board[shown.index][marks]
    shift, per_board = _seen_at(board, shown, reference)
    rim_mm = np.zeros((count, 2))
    if shown.cutouts.towards_px is not None:
        of_middle, to_rim_mm = per_board, _to_rims_mm(shown, per_board)
        half_mm = np.asarray(adjustment.stack.view.half_board_mm)[shown.index]
        shift, per_board = _seen_at(board + to_rim_mm / half_mm, shown, reference)
        rim_mm = -np.einsum("dij,dj->di", (of_middle + per_board) / 2, to_rim_mm)
    observed = adjustment.stack.observed_mm[shown.index][marks] - rim_mm
    distance = float(shown.distortion.principal_distance_mm)
    disc_mm = per_board * hole_radius_mm(shown)
    hole = no_hole(disc_mm) if broad else _holes(shown, disc_mm)
    diffraction = float(diffraction_variance_mm2(jnp.asarray(shown.f_number)))
    known = Dots(
        field_mm=observed - np.asarray(shown.distortion.principal_point_mm),
        magnified=np.full(count, distance / reference.principal_distance_mm),
        group=np.full(count, group),
        stop=np.full(count, stop),
        stop_radius=np.full(count, stop_radius),
        blades=np.zeros(count),
        slope=shift.slope,
        pupil_per_sine_mm=shift.pupil_per_sine_mm,
        vergence=shift.vergence_per_mm,
        reference=shift.reference_per_mm,
        lateral_mm=_within_bands_mm(shown, observed, bands),
        filled_mm=hole.filled_mm,
        variance_mm2=hole.variance_mm2 + diffraction,
        cell_mm=np.tile(shown.take.pixel_mm * shown.cutouts.cell_px, (count, 1)),
        broad=_broad(shown, per_board, rim_mm) if broad else None,
    )
    if not shown.take.anamorphic:
        return known
    return known._replace(sections=_sections(shift, shown.distortion))


def _seen_at(
    board: Float[np.ndarray, "dots 2"], shown: Shown, reference: Reference
) -> tuple[ObjectShift, Float[np.ndarray, "dots 2 2"]]:
    """`_seen` of places on the board of one photograph."""
    adjustment, factor = shown.geometry.adjustment, jnp.asarray(_depth_factor(shown))
    return in_batches(
        lambda some: _seen(
            jnp.asarray(adjustment.parameters),
            jnp.asarray(shown.index),
            factor,
            jnp.asarray(some),
            adjustment.stack.view,
            adjustment.layout,
            adjustment.frame,
            reference.first_order,
            jnp.asarray(reference.distance_mm),
            jnp.asarray(reference.farther),
        ),
        board,
        _BATCH,
    )


def _to_rims_mm(
    shown: Shown, per_board: Float[np.ndarray, "dots 2 2"]
) -> Float[np.ndarray, "dots 2"]:
    """On the board, from the middle of every dot to the rim that is shown."""
    assert shown.cutouts.towards_px is not None
    towards_mm = shown.cutouts.towards_px * shown.take.pixel_mm
    on_board = np.linalg.solve(per_board, towards_mm[..., None])[..., 0]
    return hole_radius_mm(shown) * on_board / np.linalg.norm(on_board, axis=-1)[:, None]


def _holes(shown: Shown, hole_mm: np.ndarray) -> Hole:
    """Of all dots of a photograph."""
    # Behind a mosaic sharp rims fall between the photosites of a colour, and lead to
    # valleys where no lens is.
    if shown.cutouts.mosaic is not None:
        return soft_hole(hole_mm)
    return hole_of(hole_mm, diameters_mm(shown))


def _sections(shift: ObjectShift, distortion: Distortion) -> Sections:
    """Of all dots of a photograph."""
    found = jax.vmap(sections_of, (0, None, None))(
        shift, distortion.principal_distance_mm, log_squeeze(distortion)
    )
    return jax.tree.map(np.asarray, found)


def _broad(
    shown: Shown,
    per_board: Float[np.ndarray, "dots 2 2"],
    rim_mm: Float[np.ndarray, "dots 2"],
) -> Broad:
    """Of marks that are drawn in waves.

    Parameters
    ----------
    per_board : d sensor mm / d board mm.
    """
    disc_mm = per_board * hole_radius_mm(shown)
    width = np.full(len(disc_mm), shown.take.widths.diameter)
    if shown.take.observations.of_corners:
        return Broad(
            np.zeros_like(disc_mm),
            rim_mm,
            np.full((len(disc_mm), NEIGHBOURS, 2), np.nan),
            _squares_mm(shown, per_board),
            np.full(len(disc_mm), _window_cells(shown)),
            width,
            Aperture(
                np.tile(np.eye(2), (len(disc_mm), 1, 1)),
                *np.ones((3, len(disc_mm))),
            ),
        )
    beside = beside_mm(shown)
    no_square = np.zeros_like(disc_mm), np.zeros(len(disc_mm))
    aperture = _aperture(shown, disc_mm, beside)
    return Broad(disc_mm, rim_mm, beside, *no_square, width, aperture)


def _window_cells(shown: Shown) -> float:
    """As detection has it."""
    blur_px = shown.take.observations.edge_blur_px
    assert blur_px is not None
    return half_width_px(blur_px) / shown.cutouts.cell_px


def _squares_mm(
    shown: Shown, per_board: Float[np.ndarray, "dots 2 2"]
) -> Float[np.ndarray, "dots 2 2"]:
    """Sides of the square that is bright ahead of every corner, in columns."""
    cut, pixel_mm = shown.cutouts, shown.take.pixel_mm
    side_mm = per_board * np.asarray(shown.take.pitch_mm)
    corner_px = shown.take.observations.points_px[cut.marks] - cut.corner_px
    ahead = bright_ahead(
        cut.light[:, _GREEN],
        cut.valid[:, _GREEN],
        corner_px / cut.cell_px,
        side_mm / (pixel_mm * cut.cell_px)[:, None],
    )
    side_mm[~ahead, :, 0] *= -1
    return side_mm


def _aperture(
    shown: Shown,
    disc_mm: Float[np.ndarray, "dots 2 2"],
    beside_mm: Float[np.ndarray, "dots neighbours 2"],
) -> Aperture:
    """As detection has it for discs blurred to the diameters that were seen."""
    pixel_mm, cell_px = shown.take.pixel_mm, shown.cutouts.cell_px
    disc_px = disc_mm / pixel_mm[:, None]
    area = np.abs(np.linalg.det(disc_px))[:, None, None]
    radius_px = diameters_mm(shown) / 2 / float(np.mean(pixel_mm))
    moment_px2 = disc_px @ disc_px.mT / 4 * radius_px[:, None, None] ** 2 / area
    apart_px = np.linalg.norm(beside_mm / pixel_mm, axis=-1)
    nearest_px = np.nan_to_num(apart_px, nan=np.inf).min(1)
    alone = ~np.isfinite(nearest_px)
    nearest_px[alone] = shown.cutouts.light.shape[-1] * cell_px
    bright = shown.take.observations.bright
    windows = windows_of(moment_px2, nearest_px, bright=bright)
    smoothing = 0.0 if bright else SMOOTHING_DARK_PX / cell_px
    return Aperture(
        np.linalg.cholesky(windows.shape_px2) / cell_px,
        windows.ring,
        windows.core,
        np.full(len(disc_mm), smoothing),
    )


def _depth_factor(shown: Shown) -> float:
    """What corrects the geometry's depths.

    Blur moves centroids outward at some f-numbers (`aperture_shift`), which looks like
    a nearer board; the takes of that state and f-number whose distance was measured say
    by how much.
    """
    ratios = [
        (take.target_distance_mm - shown.pupil_offset_mm) / depth_mm
        for take, depth_mm in zip(
            shown.geometry.takes,
            fitted_depths_mm(shown.geometry.adjustment),
            strict=True,
        )
        if take.target_distance_mm and take.f_number == shown.take.f_number
    ]
    return float(np.median(ratios)) if ratios else 1.0


def _within_bands_mm(shown: Shown, observed_mm: np.ndarray, bands: Bands) -> np.ndarray:
    """Wavelengths about their band's mean: (dots, 3, wavelengths, 2)."""
    wavelengths = bands.wavelengths_nm.shape[1]
    if shown.colour is None:
        return np.zeros((len(observed_mm), 3, wavelengths, 2))
    centre = shown.distortion.principal_point_mm
    radius = shown.distortion.reference_radius_mm
    chromatic = chromatic_coordinate(bands.wavelengths_nm)
    red, blue = shown.colour
    return in_batches(
        lambda points: _lateral_mm(
            jnp.asarray(points), red, blue, centre, radius, chromatic
        ),
        observed_mm,
        _BATCH,
    )


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
    farther: Array,
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
        return direction_of(point, parts, view, frame).at[2].multiply(factor)

    def landed(slope):
        return distorted_from_direction(jnp.append(slope, 1.0), lens)

    def slope_of(mark):
        direction = ahead(mark)
        return direction[:2] / direction[2]

    def one(mark):
        slope = slope_of(mark)
        per_slope = jax.jacfwd(landed)(slope)
        per_board = per_slope @ jax.jacfwd(slope_of)(mark) / view.half_board_mm[None]
        distance = farther * ahead(mark)[2] + first_order.entrance_pupil_offset_mm
        shift = object_shift(slope, per_slope, first_order, reference_mm, distance)
        return shift, per_board

    return jax.vmap(one)(board)

"""What is known of the dots of one photograph before the wavefront fit.

The geometry gives the field point of every dot, the size of the image of its dot
aperture, and how far from the lens that part of the chart is. All of this is taken as
known.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.detect.centroids import SMOOTHING_DARK_PX, windows_of
from lensfit.detect.corner_fit import half_width_px
from lensfit.detect.corners import window_per_square
from lensfit.fitting.chart_view import View
from lensfit.fitting.wavefront.board_places import (
    SeenBoard,
    landing_bends_mm,
    object_shifts_and_jacobians,
    seen_board_of,
)
from lensfit.fitting.wavefront.dot_aperture import (
    DotAperture,
    dot_aperture_of,
    gaussian_dot_aperture,
    no_dot_aperture,
)
from lensfit.fitting.wavefront.dot_arrays import (
    Broad,
    DetectionAperture,
    Dots,
    FocusRange,
    undrawn,
)
from lensfit.fitting.wavefront.dot_patches import (
    DotPhotograph,
    diameters_mm,
    dot_aperture_radius_mm,
    neighbour_offsets_mm,
)
from lensfit.fitting.wavefront.edges import is_square_ahead_bright
from lensfit.optics.depth import (
    ObjectShift,
    Sections,
    log_squeeze,
    sections_of,
)
from lensfit.optics.distortion import Distortion
from lensfit.optics.lateral import ChannelShift, channel_from_green
from lensfit.optics.paraxial import FirstOrder
from lensfit.optics.spectrum import Bands, chromatic_coordinate, lateral_at
from lensfit.psf.spot import diffraction_variance_mm2

_BATCH, _GREEN = 512, 1


class Reference(NamedTuple):
    """What the numbers of all dots refer to.

    Attributes
    ----------
    principal_distance_mm : Of the state nearest to being in focus.
    first_order : The thin lens with these chief rays.
    distance_mm : From the sensor, at which the aberrations hold.
    focus : Focus distances of all photographs.
    depth_scale : Factor on the depths of the geometry (`dot_data_of`).
    """

    principal_distance_mm: float
    first_order: FirstOrder
    distance_mm: float
    focus: FocusRange
    depth_scale: float = 1.0


def dots_of(
    photograph: DotPhotograph,
    group: int,
    stop: int,
    stop_radius: float,
    reference: Reference,
    bands: Bands,
    *,
    broad: bool,
) -> Dots:
    """Constants of the dots of one photograph; see `Dots`.

    Parameters
    ----------
    broad : Whether dots are discs (`waves`) rather than sampled by rays
        (`dot_aperture`).
    """
    adjustment, detection_rows = (
        photograph.geometry.adjustment,
        photograph.dot_images.marks,
    )
    count = len(detection_rows)
    seen_board = seen_board_of(photograph)
    marks = adjustment.stack.board[photograph.index][detection_rows]
    places, rim_mm, shift, per_board = _places(marks, photograph, seen_board, reference)
    observed = adjustment.stack.observed_mm[photograph.index][detection_rows] - rim_mm
    distance = float(photograph.distortion.principal_distance_mm)
    disc_mm = per_board * dot_aperture_radius_mm(photograph)
    aperture = no_dot_aperture(disc_mm) if broad else _apertures(photograph, disc_mm)
    diffraction = float(diffraction_variance_mm2(jnp.asarray(photograph.f_number)))
    known = Dots(
        field_mm=observed - np.asarray(photograph.distortion.principal_point_mm),
        principal_distance_ratio=np.full(
            count, distance / reference.principal_distance_mm
        ),
        focus=np.full(
            count, reference.focus.coordinate(photograph.take.focus_distance_mm)
        ),
        group=np.full(count, group),
        stop=np.full(count, stop),
        stop_radius=np.full(count, stop_radius),
        blades=np.zeros(count),
        slope=shift.slope,
        pupil_per_sine_mm=shift.pupil_per_sine_mm,
        vergence=shift.vergence_per_mm,
        reference=shift.reference_per_mm,
        lateral_mm=_lateral_within_bands_mm(photograph, observed, bands),
        sampled_ellipse_mm=aperture.sampled_ellipse_mm,
        variance_mm2=aperture.variance_mm2 + diffraction,
        cell_mm=np.tile(
            photograph.take.pixel_mm * photograph.dot_images.cell_px, (count, 1)
        ),
    )
    if broad:
        seen = _broad(photograph, seen_board, places, per_board, rim_mm)
        known = known._replace(broad=seen)
    if not photograph.take.anamorphic:
        return known
    return known._replace(sections=_sections(shift, photograph.distortion))


class _Places(NamedTuple):
    """Every dot, or the rim of it that is shown.

    Attributes
    ----------
    nominal : On the board, half boards.
    rim_mm : From the rim to the middle of its dot, on the sensor; zero of whole dots.
    shift : From the reference depth.
    per_board : d sensor mm / d board mm.
    """

    nominal: Float[np.ndarray, "dots 2"]
    rim_mm: Float[np.ndarray, "dots 2"]
    shift: ObjectShift
    per_board: Float[np.ndarray, "dots 2 2"]


def _places(
    marks: Float[np.ndarray, "dots 2"],
    photograph: DotPhotograph,
    seen_board: SeenBoard,
    reference: Reference,
) -> _Places:
    """Of dots whose middles are nominally there on the board, half boards."""
    known = reference.first_order, reference.distance_mm, reference.depth_scale
    shift, per_board = object_shifts_and_jacobians(marks, seen_board, *known)
    if photograph.dot_images.towards_px is None:
        return _Places(marks, np.zeros_like(marks), shift, per_board)
    of_middle, to_rim_mm = per_board, _to_rims_mm(photograph, per_board)
    at_rim = marks + to_rim_mm / seen_board.half_board_mm
    shift, per_board = object_shifts_and_jacobians(at_rim, seen_board, *known)
    between = (of_middle + per_board) / 2
    rim_mm = -np.einsum("dij,dj->di", between, to_rim_mm)
    return _Places(at_rim, rim_mm, shift, per_board)


def _to_rims_mm(
    photograph: DotPhotograph, per_board: Float[np.ndarray, "dots 2 2"]
) -> Float[np.ndarray, "dots 2"]:
    """On the board, from the middle of every dot to the rim that is shown."""
    assert photograph.dot_images.towards_px is not None
    towards_mm = photograph.dot_images.towards_px * photograph.take.pixel_mm
    on_board = np.linalg.solve(per_board, towards_mm[..., None])[..., 0]
    return (
        dot_aperture_radius_mm(photograph)
        * on_board
        / np.linalg.norm(on_board, axis=-1)[:, None]
    )


def _apertures(photograph: DotPhotograph, dot_aperture_mm: np.ndarray) -> DotAperture:
    """Of all dots of a photograph."""
    # Behind a mosaic sharp edges fall between the photosites of a colour, and cause
    # spurious local minima.
    if photograph.dot_images.mosaic is not None:
        return gaussian_dot_aperture(dot_aperture_mm)
    return dot_aperture_of(dot_aperture_mm, diameters_mm(photograph))


def _sections(shift: ObjectShift, distortion: Distortion) -> Sections:
    """Of all dots of a photograph."""
    found = jax.vmap(sections_of, (0, None, None))(
        shift, distortion.principal_distance_mm, log_squeeze(distortion)
    )
    return jax.tree.map(np.asarray, found)


def _broad(
    photograph: DotPhotograph,
    seen_board: SeenBoard,
    places: Float[np.ndarray, "dots 2"],
    per_board: Float[np.ndarray, "dots 2 2"],
    rim_mm: Float[np.ndarray, "dots 2"],
) -> Broad:
    """The targets that are drawn in waves.

    Parameters
    ----------
    places, per_board, rim_mm : As of `_Places`.
    """
    disc_mm = per_board * dot_aperture_radius_mm(photograph)
    width = np.full(len(disc_mm), photograph.take.widths.diameter)
    seen = photograph.take.observations
    if not seen.are_edges:
        beside = neighbour_offsets_mm(photograph)
        aperture = _aperture(photograph, disc_mm, beside)
        found = undrawn(len(disc_mm))
        if rim_mm.any():
            radius_mm = np.full(places.shape, dot_aperture_radius_mm(photograph))
            bend_mm = landing_bends_mm(places, seen_board, radius_mm)
            found = found._replace(bend_mm=bend_mm)
        return found._replace(
            disc_mm=disc_mm,
            rim_mm=rim_mm,
            neighbour_offsets_mm=beside,
            size_width=width,
            aperture=aperture,
        )
    pitch_mm = np.tile(photograph.take.pitch_mm, (len(disc_mm), 1))
    if seen.are_corners:
        along = _bright_ahead_along(photograph, per_board)
        return undrawn(len(disc_mm))._replace(
            square_mm=per_board * (pitch_mm * along)[:, None],
            bend_mm=landing_bends_mm(places, seen_board, pitch_mm * along),
            window_cells=np.full(len(disc_mm), _window_cells(photograph)),
            window_squares=np.full(len(disc_mm), window_per_square(seen.markers)),
            lattice=seen.lattice[photograph.dot_images.marks],
            size_width=width,
        )
    bend_mm = landing_bends_mm(places, seen_board, pitch_mm)
    return _lines(photograph, per_board)._replace(bend_mm=bend_mm, size_width=width)


def _lines(
    photograph: DotPhotograph, per_board: Float[np.ndarray, "dots 2 2"]
) -> Broad:
    """The lines around samples."""
    take, count = photograph.take, len(per_board)
    assert take.mark_diameter_mm is not None
    sign = 1 if take.observations.bright else -1
    square_mm = per_board * np.asarray(take.pitch_mm)
    return undrawn(count)._replace(
        # The variance across a line is w^2 / 12, along any axis of a disc r^2 / 4.
        disc_mm=per_board * take.mark_diameter_mm / np.sqrt(3),
        square_mm=square_mm,
        lattice=take.observations.lattice[photograph.dot_images.marks],
        line_width=np.tile(
            sign * take.mark_diameter_mm / np.asarray(take.pitch_mm), (count, 1)
        ),
        line_window_mm=_line_windows_mm(take, square_mm),
    )


def _line_windows_mm(
    take: View, square_mm: Float[np.ndarray, "dots 2 2"]
) -> Float[np.ndarray, "dots 3 3"]:
    """What detection reads along rows or columns, measured across the lines."""
    assert take.observations.lines is not None
    windows_px = [
        (one.half_width_px, one.fade_px, one.flank_px)
        for one in take.observations.lines.windows
    ]
    along = square_mm[..., 1] / np.linalg.norm(square_mm[..., 1], axis=-1)[:, None]
    slant = np.abs(along).max(-1)
    window_mm = np.resize(windows_px, (3, 3)) * float(np.mean(take.pixel_mm))
    return slant[:, None, None] * window_mm


def _window_cells(photograph: DotPhotograph) -> float:
    """As detection has it."""
    blur_px = photograph.take.observations.edge_blur_px
    assert blur_px is not None
    return half_width_px(blur_px) / photograph.dot_images.cell_px


def _bright_ahead_along(
    photograph: DotPhotograph, per_board: Float[np.ndarray, "dots 2 2"]
) -> Float[np.ndarray, "dots 2"]:
    """Directions along both axes of the board, 1 ahead and -1 back, between which the
    square at every corner is a bright one."""
    cut, pixel_mm = photograph.dot_images, photograph.take.pixel_mm
    side_mm = per_board * np.asarray(photograph.take.pitch_mm)
    seen = photograph.take.observations
    if seen.markers is not None:
        corners = np.rint(seen.lattice[cut.marks]).astype(int)
        ahead = seen.markers.is_bright_ahead(corners)
    else:
        ahead = is_square_ahead_bright(
            cut.light[:, _GREEN],
            cut.valid[:, _GREEN],
            (seen.points_px[cut.marks] - cut.corner_px) / cut.cell_px,
            side_mm / (pixel_mm * cut.cell_px)[:, None],
        )
    return np.stack([np.where(ahead, 1.0, -1.0), np.ones(len(ahead))], -1)


def _aperture(
    photograph: DotPhotograph,
    disc_mm: Float[np.ndarray, "dots 2 2"],
    neighbour_offsets_mm: Float[np.ndarray, "dots neighbours 2"],
) -> DetectionAperture:
    """As detection has it for discs blurred to the measured diameters."""
    pixel_mm, cell_px = photograph.take.pixel_mm, photograph.dot_images.cell_px
    disc_px = disc_mm / pixel_mm[:, None]
    area = np.abs(np.linalg.det(disc_px))[:, None, None]
    radius_px = diameters_mm(photograph) / 2 / float(np.mean(pixel_mm))
    moment_px2 = disc_px @ disc_px.mT / 4 * radius_px[:, None, None] ** 2 / area
    apart_px = np.linalg.norm(neighbour_offsets_mm / pixel_mm, axis=-1)
    nearest_px = np.nan_to_num(apart_px, nan=np.inf).min(1)
    alone = ~np.isfinite(nearest_px)
    nearest_px[alone] = photograph.dot_images.light.shape[-1] * cell_px
    bright = photograph.take.observations.bright
    windows = windows_of(moment_px2, nearest_px, bright=bright)
    smoothing = 0.0 if bright else SMOOTHING_DARK_PX / cell_px
    return DetectionAperture(
        np.linalg.cholesky(windows.shape_px2) / cell_px,
        windows.ring,
        windows.core,
        np.full(len(disc_mm), smoothing),
    )


def _lateral_within_bands_mm(
    photograph: DotPhotograph, observed_mm: np.ndarray, bands: Bands
) -> np.ndarray:
    """Wavelengths about their band's mean: (dots, 3, wavelengths, 2)."""
    wavelengths = bands.wavelengths_nm.shape[1]
    if photograph.colour is None:
        return np.zeros((len(observed_mm), 3, wavelengths, 2))
    centre = photograph.distortion.principal_point_mm
    radius = photograph.distortion.reference_radius_mm
    chromatic = chromatic_coordinate(bands.wavelengths_nm)
    red, blue = photograph.colour
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

"""One photograph as input of the wavefront fit: images of dots, and their geometry.

A broad dot's neighbours reach into its patch, and where blur is wide into its light:
those that were detected, and those that the frame cuts. A dot that lies across the
frame's edge is not detected, yet sends light. It is assumed to lie opposite the
detected neighbour on the other side, at the same distance.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from lensfit.detect.dot_images import DotImages
from lensfit.detect.observations import Observations
from lensfit.fitting.chart_view import View
from lensfit.fitting.chief_ray import ChiefRayFit
from lensfit.fitting.wavefront.dot_arrays import NEIGHBOURS
from lensfit.optics.distortion import Distortion
from lensfit.optics.lateral import ChannelShift

LARGEST_RAY_SAMPLED_CELLS, _LARGEST_BESIDE_CELLS = 0.9, 1.1
"""Of a dot aperture's radius. In larger ones some hundreds of rays leave gaps
(`dot_aperture`): these are drawn as discs (`waves`), which takes several times as long.
A little larger may be those of a chart that is small enough in other photographs: where
the lens is focused nearer, the picture is larger by some percent."""
LARGEST_DOT_APERTURE_CELLS = 8.5
"""Of a dot's radius: its rim has to be on its patch, whose cells grow with it."""


class DotPhotograph(NamedTuple):
    """One photograph with dot patches, and the geometry of its state."""

    take: View
    dot_images: DotImages
    geometry: ChiefRayFit
    distortion: Distortion
    colour: tuple[ChannelShift, ChannelShift] | None
    """Displacement of red and blue, as far as known."""
    index: int
    """Of the take within the geometry."""
    pupil_offset_mm: float
    """Entrance pupil in front of the sensor, as in the geometry."""
    f_number: float
    """As on the barrel; the unit of the pupil where nobody stated it."""


def are_of_one_setting(photographs: Iterable[DotPhotograph]) -> bool:
    """Whether all photographs have one f-number and one focus distance."""
    return len({(one.f_number, one.take.focus_distance_mm) for one in photographs}) == 1


def usable_cells(dot_images: DotImages) -> Bool[np.ndarray, "dots 3 rows columns"]:
    """Cells to use of each channel: a grey photograph has only green."""
    channels = np.array([dot_images.channels == 3, True, dot_images.channels == 3])
    return dot_images.valid & channels[None, :, None, None]


def rim_patches(photographs: list[DotPhotograph]) -> list[DotPhotograph]:
    """The same photographs with patches of the rims of large dots in place of whole
    dots, where rims have finer cells."""
    return [
        one if one.take.rims is None else one._replace(dot_images=one.take.rims)
        for one in photographs
    ]


def dot_aperture_radius_cells(photograph: DotPhotograph) -> float:
    """Radius of the dot aperture's image, in cells of its patch.

    Of an anamorphic lens half the larger one: dot apertures as large along one axis
    alone have been fitted well.
    """
    stack, rows = photograph.geometry.adjustment.stack, photograph.dot_images.marks
    half_mm = np.asarray(stack.view.half_board_mm[photograph.index])
    board = stack.board[photograph.index][rows] * half_mm
    areas = [
        np.linalg.det(np.cov(points.T))
        for points in (stack.observed_mm[photograph.index][rows], board)
    ]
    magnification = (areas[0] / areas[1]) ** 0.25
    cell_mm = float(np.mean(photograph.take.pixel_mm)) * photograph.dot_images.cell_px
    squeeze = photograph.take.squeeze
    larger = max(squeeze, 1 / squeeze) ** 0.5 / 2 if photograph.take.anamorphic else 1.0
    return dot_aperture_radius_mm(photograph) * magnification / cell_mm * larger


def are_broad(photographs: Sequence[DotPhotograph]) -> bool:
    """Whether targets of these photographs are too wide to be sampled by rays."""
    if any(one.take.observations.are_edges for one in photographs):
        return True
    radii = [dot_aperture_radius_cells(one) for one in photographs]
    return min(radii) > LARGEST_RAY_SAMPLED_CELLS or max(radii) > _LARGEST_BESIDE_CELLS


def dot_aperture_radius_mm(photograph: DotPhotograph) -> float:
    """Radius of the dot aperture itself, on the chart."""
    return float(photograph.geometry.adjustment.radius_mm[photograph.index])


def diameters_mm(photograph: DotPhotograph) -> Float[np.ndarray, " dots"]:
    """Diameter of the disc of each dot's second moment, of the blur of a corner's edges
    or of the light across a line, less the pixel's own.

    A pixel adds a twelfth of its square to the second moment of each axis.
    """
    seen = photograph.take.observations
    blur = seen.edge_blur_px
    diameter = (seen.diameter_px if blur is None else 4 * blur)[
        photograph.dot_images.marks
    ]
    square = np.maximum(diameter**2 - 16 / 12, 0.0)
    return np.sqrt(square) * float(np.mean(photograph.take.pixel_mm))


def centroids_mm(take: View, dot_images: DotImages) -> Float[np.ndarray, "dots 3 2"]:
    """Centroid of every channel, from the corner of its cells in the patch."""
    observations = take.observations
    green = observations.points_px[dot_images.marks]
    channels = observations.channel_points_px[:, dot_images.marks]
    channels = np.where(np.isfinite(channels), channels, green[None])
    corner = dot_images.corner_px[:, None] + dot_images.offset_px
    from_corner = channels.transpose(1, 0, 2) - corner
    return from_corner * take.pixel_mm


_CUT_DIAMETERS = 1.0
"""Distance from the frame's edge within which a dot may be cut and not detected."""


def neighbour_offsets_mm(
    photograph: DotPhotograph,
) -> Float[np.ndarray, "dots neighbours 2"]:
    """From every dot with a patch to those around it; NaN where there is none."""
    found = neighbour_offsets_px(
        photograph.take.observations, photograph.dot_images.marks
    )
    return found * photograph.take.pixel_mm


def neighbour_offsets_px(
    detections: Observations, rows: Int[np.ndarray, " dots"]
) -> Float[np.ndarray, "dots neighbours 2"]:
    """From some of the detected dots to those around each; NaN where there is none."""
    seen = np.isfinite(detections.diameter_px)
    steps = _steps(detections.lattice[seen])
    here, lattice = (
        detections.points_px[rows][:, None],
        detections.lattice[rows][:, None],
    )
    beside = _points_at(detections, lattice + steps) - here
    across = here - _points_at(detections, lattice - steps)
    reach_px = _CUT_DIAMETERS * float(np.median(detections.diameter_px[seen]))
    cut = ~_is_within(here + across, detections.image_size_px, reach_px)
    missing = np.isnan(beside).any(-1, keepdims=True)
    return np.where(missing & cut[..., None], across, beside)


def own_cells(
    photograph: DotPhotograph,
    neighbour_offsets_mm: Float[np.ndarray, "dots neighbours 2"],
) -> Bool[np.ndarray, "dots rows columns"]:
    """Cells of every patch nearer to its own dot than to any neighbour."""
    dot_images, pixel_mm = photograph.dot_images, photograph.take.pixel_mm
    centre_px = photograph.take.observations.points_px[dot_images.marks]
    middle_px = (np.arange(dot_images.light.shape[-1]) + 0.5) * dot_images.cell_px
    x, y = (dot_images.corner_px - centre_px).T[..., None] + middle_px
    neighbour_offsets_px = neighbour_offsets_mm / pixel_mm
    towards = np.einsum("dn,dc->dnc", neighbour_offsets_px[..., 0], x)[:, :, None]
    towards = (
        towards + np.einsum("dn,dr->dnr", neighbour_offsets_px[..., 1], y)[..., None]
    )
    half = np.sum(neighbour_offsets_px**2, -1)[..., None, None] / 2
    # A neighbour that does not exist, NaN, has no cells.
    return ~np.any(towards > half, 1)


def _steps(lattice: Float[np.ndarray, "dots 2"]) -> Float[np.ndarray, "neighbours 2"]:
    """Around a dot in the middle of the grid, in pitches."""
    middle = int(np.argmin(np.sum((lattice - lattice.mean(0)) ** 2, -1)))
    away = lattice - lattice[middle]
    nearest = np.argsort(np.sum(away**2, -1), kind="stable")
    # The dot itself comes first.
    return away[nearest[1 : NEIGHBOURS + 1]]


def _points_at(
    detections: Observations, lattice: Float[np.ndarray, "*shape 2"]
) -> Float[np.ndarray, "*shape 2"]:
    """Detected points at these lattice coordinates; NaN where there is none."""
    away, nearest = KDTree(detections.lattice).query(lattice)
    found = np.asarray(away) < 0.1
    return np.where(found[..., None], detections.points_px[np.asarray(nearest)], np.nan)


def _is_within(
    points_px: Float[np.ndarray, "*shape 2"], size_px: tuple[int, int], reach_px: float
) -> Bool[np.ndarray, "*shape"]:
    """Whether points lie in the frame by this distance; true where they are NaN."""
    inside = (points_px >= reach_px) & (points_px <= np.array(size_px) - reach_px)
    return np.asarray(inside.all(-1) | np.isnan(points_px).any(-1))

"""One photograph as the wavefront fit sees it: pictures of dots, and their geometry."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lensfit.detect.cutouts import Cutouts
from lensfit.fitting.chief_ray import ChiefRayFit
from lensfit.fitting.take import Take
from lensfit.optics.distortion import Distortion
from lensfit.optics.lateral import ChannelShift

LARGEST_PLACED_CELLS = 0.9
"""Of a hole's radius. In larger ones some hundreds of rays leave gaps (`dot_aperture`):
these are drawn as discs (`waves`)."""
LARGEST_HOLE_CELLS = 8.5
"""Of a dot's radius: its rim has to be on its cutout, whose cells grow with it."""


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
    pupil_offset_mm: float
    """Entrance pupil in front of the sensor, as in the geometry."""
    f_number: float
    """As on the barrel; the unit of the opening where nobody said it."""


def are_of_one_setting(shown: Iterable[Shown]) -> bool:
    """Whether all photographs have one f-number and one focus distance."""
    return len({(one.f_number, one.take.focus_distance_mm) for one in shown}) == 1


def usable_cells(cutouts: Cutouts) -> Bool[np.ndarray, "dots 3 rows columns"]:
    """Cells to use of each channel: a grey photograph has only green."""
    channels = np.array([cutouts.channels == 3, True, cutouts.channels == 3])
    return cutouts.valid & channels[None, :, None, None]


def with_rims(shown: list[Shown]) -> list[Shown]:
    """The same with the rims of large dots in place of the dots, where these show finer
    cells."""
    return [
        one if one.take.rims is None else one._replace(cutouts=one.take.rims)
        for one in shown
    ]


def hole_cells(shown: Shown) -> float:
    """Radius of the hole's image, in cells of its cutout.

    Of an anamorphic lens half the larger one: holes as large along one axis alone have
    been fitted well.
    """
    stack, rows = shown.geometry.adjustment.stack, shown.cutouts.marks
    half_mm = np.asarray(stack.view.half_board_mm[shown.index])
    board = stack.board[shown.index][rows] * half_mm
    areas = [
        np.linalg.det(np.cov(points.T))
        for points in (stack.observed_mm[shown.index][rows], board)
    ]
    magnification = (areas[0] / areas[1]) ** 0.25
    cell_mm = float(np.mean(shown.take.pixel_mm)) * shown.cutouts.cell_px
    squeeze = shown.take.squeeze
    larger = max(squeeze, 1 / squeeze) ** 0.5 / 2 if shown.take.anamorphic else 1.0
    return hole_radius_mm(shown) * magnification / cell_mm * larger


def hole_radius_mm(shown: Shown) -> float:
    """Of the hole itself, on the chart."""
    return float(shown.geometry.adjustment.radius_mm[shown.index])


def diameters_mm(shown: Shown) -> Float[np.ndarray, " dots"]:
    """Of the disc of each dot's second moment, or of the blur of a corner's edges, the
    pixel's own taken off.

    A pixel adds a twelfth of its square to the second moment of each axis.
    """
    seen = shown.take.observations
    blur = seen.edge_blur_px
    diameter = (seen.diameter_px if blur is None else 4 * blur)[shown.cutouts.marks]
    square = np.maximum(diameter**2 - 16 / 12, 0.0)
    return np.sqrt(square) * float(np.mean(shown.take.pixel_mm))


def centroids_mm(take: Take, cutouts: Cutouts) -> Float[np.ndarray, "dots 3 2"]:
    """Of every channel, from the corner of its cells in the cutout."""
    observations = take.observations
    green = observations.points_px[cutouts.marks]
    channels = observations.channel_points_px[:, cutouts.marks]
    channels = np.where(np.isfinite(channels), channels, green[None])
    corner = cutouts.corner_px[:, None] + cutouts.offset_px
    from_corner = channels.transpose(1, 0, 2) - corner
    return from_corner * take.pixel_mm

"""Small pictures of all dots, for the fit of their shape.

A cutout is a square of cells, a cell a square of pixels: one where dots are small, more
where they are blurred, so that every photograph gives cutouts of the same shape.

Cells that hold a pixel outside the frame, or nearer to another dot, are masked; cells
with a clipped pixel are marked, since the light there is at least what was recorded.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from lensfit.detect.observations import Observations
from lensfit.photograph import Photograph

CELLS = 24
"""Along each side of a cutout."""
_REACH = 1.5
"""Half the cutout over the radius of a dot."""
_MARGIN_PX = 3.0
_LARGEST_CELL_PX = 16


@dataclass(frozen=True, eq=False)
class Cutouts:
    """Pictures of the dots of one photograph.

    Attributes
    ----------
    marks : Which of the observations.
    light : Mean of each cell, scene-linear, r, g, b (one channel thrice if grey).
    valid : Cells to use.
    clipped : Cells that hold a saturated pixel.
    corner_px : Pixel corner of cell (0, 0): column, row.
    cell_px : Pixels along a cell.
    read_noise : Standard deviation of a cell without light, per channel.
    channels : 3, or 1 for a grey photograph.
    """

    marks: Int[np.ndarray, " dots"]
    light: Float[np.ndarray, "dots 3 rows columns"]
    valid: Bool[np.ndarray, "dots rows columns"]
    clipped: Bool[np.ndarray, "dots 3 rows columns"]
    corner_px: Int[np.ndarray, "dots 2"]
    cell_px: int
    read_noise: Float[np.ndarray, " 3"]
    channels: int


def cut(photograph: Photograph, marks: Observations) -> Cutouts | None:
    """Cutouts of all dots that have a size; None where none has."""
    sized = np.isfinite(marks.diameter_px) & np.isfinite(marks.points_px).all(-1)
    chosen = np.flatnonzero(sized)
    if not len(chosen):
        return None
    radius = float(np.quantile(marks.diameter_px[chosen], 0.9)) / 2
    half = _REACH * radius + _MARGIN_PX
    cell = min(max(int(np.ceil(2 * half / CELLS)), 1), _LARGEST_CELL_PX)
    corner = np.round(marks.points_px[chosen] - cell * CELLS / 2).astype(int)
    pixels = photograph.pixels
    if pixels.shape[2] == 1:
        pixels = np.repeat(pixels, 3, axis=2)
    light, inside, clipped = _cells(pixels, photograph.saturation, corner, cell)
    return Cutouts(
        marks=chosen,
        light=light,
        valid=inside & _nearest_is_own(marks.points_px, chosen, corner, cell),
        clipped=clipped,
        corner_px=corner,
        cell_px=cell,
        read_noise=_read_noise(pixels) / cell,
        channels=photograph.pixels.shape[2],
    )


def _cells(
    pixels: np.ndarray, saturation: float, corner: np.ndarray, cell: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Light (dots, 3, cells, cells), whether inside the frame, whether clipped."""
    size = cell * CELLS
    height, width = pixels.shape[:2]
    shape = (CELLS, cell, CELLS, cell)
    light = np.zeros((len(corner), 3, CELLS, CELLS), np.float32)
    inside = np.zeros((len(corner), CELLS, CELLS), bool)
    clipped = np.zeros(light.shape, bool)
    for k, (x, y) in enumerate(corner):
        window = np.full((size, size, 3), np.nan, np.float32)
        to_x, to_y = slice(max(-x, 0), width - x), slice(max(-y, 0), height - y)
        window[to_y, to_x] = pixels[max(y, 0) : y + size, max(x, 0) : x + size]
        cells = np.moveaxis(window, -1, 0).reshape(3, *shape)
        mean = cells.mean((2, 4))
        inside[k] = np.isfinite(mean).all(0)
        light[k] = np.nan_to_num(mean)
        if np.isfinite(saturation):
            clipped[k] = (cells >= saturation).any((2, 4))
    return light, inside, clipped


def _nearest_is_own(points_px, chosen, corner, cell) -> np.ndarray:
    """Cells whose nearest dot is the cutout's own."""
    middle = (np.arange(CELLS) + 0.5) * cell
    x = corner[:, 0, None, None] + middle[None, None]
    y = corner[:, 1, None, None] + middle[None, :, None]
    x, y = np.broadcast_arrays(x, y)
    _, nearest = KDTree(points_px).query(np.stack([x, y], -1))
    return nearest == chosen[:, None, None]


def _read_noise(pixels: np.ndarray) -> np.ndarray:
    """Deviation of neighbouring pixels where it is darkest, per channel.

    The tails are left out, but not by a median: where black is recorded as 0 most
    steps between neighbours are 0 too.
    """
    sample = pixels[::2, ::2].astype(np.float32)
    smooth = cv2.boxFilter(sample, -1, (5, 5))
    noise = []
    for k in range(3):
        dark = smooth[..., k] <= np.quantile(smooth[..., k], 0.25)
        step = (sample[:, 1:, k] - sample[:, :-1, k])[dark[:, 1:]]
        usual = np.abs(step) <= np.quantile(np.abs(step), 0.995)
        noise.append(np.sqrt(np.mean(step[usual] ** 2) / 2))
    return np.asarray(noise, float)

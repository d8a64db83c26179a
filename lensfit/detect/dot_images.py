"""Small pictures of dots, checker corners and lines, for the fit of their shape.

A dot image is a square of cells, a cell a square of pixels: one where dots are small,
more where they are blurred, so that every photograph gives patches of the same shape.

Cells that hold a pixel outside the frame, or nearer to another dot, are masked (a line
is drawn with those around it, and masks none); cells with a clipped pixel are marked,
since the light there is at least what was recorded. Dark dots are inverted: their light
is how much darker they are than their surround. Noise is larger there, and the value of
a clipped pixel is unknown.

Of a mosaic's picture a cell of one pixel is usable in the one channel that was measured
there. Larger cells are an even number of pixels wide, so that each holds the photosites
of every channel at the same places, and their mean is the cell's light about those.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from lensfit.detect.observations import Observations
from lensfit.mosaic import PIXELS_PER_PHOTOSITE, Mosaic, photosites
from lensfit.photograph import Photograph

CELLS = 24
"""Along each side of a dot image."""
_REACH = 1.5
"""Half the width of a dot image over the radius of the dot."""
BLURS = 3.0
"""Half the width of a dot image over the standard deviation of the blur of an edge."""
MARGIN_PX = 3.0
_MOST_OF_LINES = 400
_FROM_ENDS = 0.5
"""Pitches from the outermost lines, beyond which nobody knows where lines end."""
_AROUND = 0.9
"""Quantile of a dot image's light that is the surround of a dark dot."""
_LARGEST_CELL_PX = 16
_LOOKED_AT = 3
"""Of so many columns and rows one tells what is dark and even."""


@dataclass(frozen=True, eq=False)
class DotImages:
    """The pixels around each dot of one photograph.

    Attributes
    ----------
    marks : Which of the observations.
    light : Mean of each cell, scene-linear, r, g, b (one channel thrice if grey); of a
        mosaic's picture the mean of what was measured, where there is such; of dark
        dots how much darker it is than around the dot.
    valid : Cells to use.
    clipped : Cells that hold a saturated pixel and are used for what it was at least.
    corner_px : Pixel corner of cell (0, 0): column, row.
    offset_px : Of each channel's middle of a cell from the cell's: column, row.
    cell_px : Pixels along a cell.
    pixel_noise : Standard deviation of a measured pixel beside the dots, per channel.
    channels : 3, or 1 for a grey photograph.
    mosaic : Of the photograph, if each pixel measured one channel.
    towards_px : From the middle of a dot to the imaged rim; None for whole dots.
    """

    marks: Int[np.ndarray, " dots"]
    light: Float[np.ndarray, "dots 3 rows columns"]
    valid: Bool[np.ndarray, "dots 3 rows columns"]
    clipped: Bool[np.ndarray, "dots 3 rows columns"]
    corner_px: Int[np.ndarray, "dots 2"]
    offset_px: Float[np.ndarray, "3 2"]
    cell_px: int
    pixel_noise: Float[np.ndarray, " 3"]
    channels: int
    mosaic: Mosaic | None = None
    towards_px: Float[np.ndarray, "dots 2"] | None = None

    @property
    def read_noise(self) -> Float[np.ndarray, " 3"]:
        """Standard deviation of a cell beside the dots, per channel."""
        return self.pixel_noise / _pixels_of_noise(self.mosaic, self.cell_px)


def cut_dot_images(photograph: Photograph, marks: Observations) -> DotImages | None:
    """Dot images of all dots that have a size, or of corners; None where none has."""
    reach_px = _reaches_px(marks)
    sized = np.isfinite(reach_px) & np.isfinite(marks.points_px).all(-1)
    chosen = np.flatnonzero(sized)
    if marks.are_lines:
        chosen = _inner_samples(marks, chosen)
    if not len(chosen):
        return None
    half = float(np.quantile(reach_px[chosen], 0.9)) + MARGIN_PX
    pixels, own = _three_channels(photograph), _measured_photosites(photograph)
    noise = _pixel_noise(-pixels if marks.are_dark_dots else pixels, own)
    middle_px = marks.points_px[chosen]
    return dot_images_about(
        photograph, marks, chosen, middle_px, cell_px_of(half), noise
    )


def cell_px_of(half_px: float) -> int:
    """Pixels along a cell of patches with this half width."""
    return min(max(int(np.ceil(2 * half_px / CELLS)), 1), _LARGEST_CELL_PX)


def dot_images_about(
    photograph: Photograph,
    marks: Observations,
    chosen: Int[np.ndarray, " dots"],
    middle_px: Float[np.ndarray, "dots 2"],
    cell: int,
    pixel_noise: Float[np.ndarray, " 3"],
) -> DotImages:
    """Dot images of some of the detections, each about a given position.

    Parameters
    ----------
    cell : Pixels along a cell, at least.
    pixel_noise : As `DotImages` has it.
    """
    pixels, own = _three_channels(photograph), _measured_photosites(photograph)
    align = 1
    if own is not None and cell > 1:
        cell, align = cell + cell % 2, 2
    corner = (middle_px - cell * CELLS / 2) / align
    corner = align * np.round(corner).astype(int)
    cells = _cells(pixels, own, photograph.saturation, corner, cell)
    own_cells = cells.inside
    if not marks.are_lines:
        own_cells = own_cells & _nearest_is_own(marks.points_px, chosen, corner, cell)
    light, clipped = cells.light, cells.clipped
    if marks.are_edges:
        light = _continued_beyond_frame(light, cells.inside)
    usable = cells.measured & own_cells[:, None]
    if marks.are_dark_dots:
        usable = usable & ~clipped
        light, clipped = _light_taken(light, usable), np.zeros_like(clipped)
    return DotImages(
        marks=chosen,
        light=light,
        valid=usable,
        clipped=clipped,
        corner_px=corner,
        offset_px=_offset_px(own, cell),
        cell_px=cell,
        pixel_noise=pixel_noise,
        channels=photograph.pixels.shape[2],
        mosaic=None if own is None else photograph.mosaic,
    )


def _reaches_px(marks: Observations) -> Float[np.ndarray, " marks"]:
    """How far from each mark its light tells of the lens; NaN of those without size."""
    if marks.edge_blur_px is not None:
        return BLURS * marks.edge_blur_px
    return _REACH * marks.diameter_px / 2


def _inner_samples(
    marks: Observations, chosen: Int[np.ndarray, " samples"]
) -> Int[np.ndarray, " some"]:
    """Some samples of lines, evenly, none of the outermost lines or near the ends."""
    number, first = marks.lattice[chosen], marks.lattice.min(0)
    inner = (number > first + _FROM_ENDS) & (number < marks.lattice.max(0) - _FROM_ENDS)
    inner = chosen[inner.all(-1)]
    few = np.linspace(0, len(inner) - 1, min(len(inner), _MOST_OF_LINES))
    return inner[few.astype(int)]


def _measured_photosites(photograph: Photograph) -> np.ndarray | None:
    """Where each channel was measured; None if everywhere."""
    if photograph.mosaic is None or photograph.pixels.shape[2] == 1:
        return None
    return photosites(photograph.mosaic, photograph.size_px)


class _Cells(NamedTuple):
    """Light, whether clipped and whether measured (dots, 3, cells, cells); whether
    inside the frame (dots, cells, cells)."""

    light: np.ndarray
    clipped: np.ndarray
    measured: np.ndarray
    inside: np.ndarray


def _cells(
    pixels: np.ndarray,
    own: np.ndarray | None,
    saturation: float,
    corner: np.ndarray,
    cell: int,
) -> _Cells:
    size = cell * CELLS
    height, width = pixels.shape[:2]
    shape = (3, CELLS, cell, CELLS, cell)
    light = np.zeros((len(corner), 3, CELLS, CELLS), np.float32)
    inside = np.zeros((len(corner), CELLS, CELLS), bool)
    clipped, measured = np.zeros(light.shape, bool), np.ones(light.shape, bool)
    for k, (x, y) in enumerate(corner):
        to = slice(max(-y, 0), height - y), slice(max(-x, 0), width - x)
        part = slice(max(y, 0), y + size), slice(max(x, 0), x + size)
        window = np.full((size, size, 3), np.nan, np.float32)
        window[to] = pixels[part]
        cells = np.moveaxis(window, -1, 0).reshape(shape)
        inside[k] = np.isfinite(cells).all((0, 2, 4))
        mean = cells.mean((2, 4))
        if own is not None:
            window = np.zeros((size, size, 3), bool)
            window[to] = own[part]
            mine = np.moveaxis(window, -1, 0).reshape(shape)
            count = mine.sum((2, 4))
            measured[k] = count > 0
            of_mine = np.where(mine, cells, 0).sum((2, 4)) / np.maximum(count, 1)
            mean = np.where(measured[k], of_mine, mean)
            cells = np.where(mine, cells, -np.inf)
        light[k] = np.nan_to_num(mean)
        if np.isfinite(saturation):
            clipped[k] = (cells >= saturation).any((2, 4))
    return _Cells(light, clipped, measured, inside)


def _continued_beyond_frame(light: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Cells outside the frame as the nearest ones in it. Edges leave the frame, and a
    fit that smooths patches mixes in what lies there."""
    found = light.copy()
    for k in np.flatnonzero(inside.any((1, 2)) & ~inside.all((1, 2))):
        rows, columns = (np.flatnonzero(inside[k].any(axis)) for axis in (1, 0))
        beyond = [(seen[0], CELLS - 1 - seen[-1]) for seen in (rows, columns)]
        known = light[k][:, *np.ix_(rows, columns)]
        found[k] = np.pad(known, [(0, 0), *beyond], mode="edge")
    return found


def _light_taken(light: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """By dark dots from what surrounds them; what is not known takes none."""
    nothing = ~usable.any((2, 3), keepdims=True)
    known = np.where(nothing, 0.0, np.where(usable, light, np.nan))
    around = np.nanquantile(known, _AROUND, (2, 3), keepdims=True)
    return np.where(usable, around - light, 0.0).astype(np.float32)


def _offset_px(own: np.ndarray | None, cell: int) -> np.ndarray:
    """Where each channel's photosites of a cell lie on average, from its middle."""
    if own is None or cell == 1:
        return np.zeros((3, 2))
    rows_columns = [np.argwhere(own[:2, :2, k]).mean(0) for k in range(3)]
    return np.stack(rows_columns)[:, ::-1] - 0.5


def _three_channels(photograph: Photograph) -> np.ndarray:
    """Its pixels; those of a grey one thrice."""
    pixels = photograph.pixels
    return np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels


def _pixels_of_noise(mosaic: Mosaic | None, cell: int) -> np.ndarray:
    """Root of how many measured values a cell is the mean of, for each channel."""
    if mosaic is None or cell == 1:
        return np.full(3, float(cell))
    return cell / np.sqrt(PIXELS_PER_PHOTOSITE)


def _nearest_is_own(points_px, chosen, corner, cell) -> np.ndarray:
    """Cells whose nearest dot is the image's own dot."""
    middle = (np.arange(CELLS) + 0.5) * cell
    x = corner[:, 0, None, None] + middle[None, None]
    y = corner[:, 1, None, None] + middle[None, :, None]
    x, y = np.broadcast_arrays(x, y)
    _, nearest = KDTree(points_px).query(np.stack([x, y], -1))
    return nearest == chosen[:, None, None]


def _pixel_noise(pixels: np.ndarray, own: np.ndarray | None) -> np.ndarray:
    """Deviation of pixels where it is dark and even, per channel: from the next but
    one, or from a parabola through those around, whichever is less.

    The picture itself adds to both: its slopes to the first where blur is wide, its
    edges to the second where they are sharp.

    The tails are left out, but not by a median: where black is recorded as 0 most
    steps between neighbours are 0 too. Interpolated pixels have less noise than those
    that were measured, and share it.
    """
    noise = []
    for k in range(3):
        row, column = (0, 0) if own is None else np.argwhere(own[:2, :2, k])[0]
        half = pixels[row::2, column::2, k].astype(np.float32)
        even = _where_even(half)
        step = (half[:, 1:] - half[:, :-1])[even[:, 1:]] / np.sqrt(2)
        if own is None:
            half = pixels[..., k].astype(np.float32)
            even = _where_even(half)
        off = cv2.filter2D(half, -1, _OFF_PARABOLA)[even]
        noise.append(min(map(_usual_size, (step, off))))
    return np.asarray(noise, float)


def _where_even(light: np.ndarray) -> np.ndarray:
    """The darkest quarter without the half that slopes most: edges are in that."""
    smooth = cv2.boxFilter(light, -1, (5, 5))
    right, down = (cv2.Sobel(smooth, -1, *way) for way in ((1, 0), (0, 1)))
    slope2 = right**2 + down**2
    some = np.s_[::_LOOKED_AT, ::_LOOKED_AT]
    dark = smooth <= np.quantile(smooth[some], 0.25)
    return dark & (slope2 <= np.median(slope2[some][dark[some]]))


def _usual_size(differences: np.ndarray) -> float:
    """Root mean square without the tails."""
    size = np.abs(differences)
    return float(np.sqrt(np.mean(size[size <= np.quantile(size, 0.995)] ** 2)))


def _off_parabola(half: int) -> np.ndarray:
    """Kernel that gives how far a pixel is from the parabola of least squares through
    the square around it, over the deviation of that for noise of 1."""
    y, x = np.mgrid[-half : half + 1, -half : half + 1].reshape(2, -1)
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], -1)
    off = np.eye(len(x)) - design @ np.linalg.pinv(design)
    middle = off[len(x) // 2]
    return (middle / np.linalg.norm(middle)).reshape(2 * half + 1, -1)


_OFF_PARABOLA = _off_parabola(2)

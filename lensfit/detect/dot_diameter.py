"""The diameter of a chart's dots from their images, and pictures of large ones' rims.

Blur conserves light. The flux of a dot divided by the radiance at its middle is
therefore its area, however blurred its rim, as long as the middle is as bright as that
of a larger dot. The lattice cell around a dot has the same distortion and perspective,
so that the ratio of both areas in the image is that on the chart.

What a large dot shows of the blur stands along its rim, and a dot image as large as the
dot has cells too coarse for it. Each dot is shown from four sides, turned from dot to
dot, so that edges of all directions are seen all over the frame.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lensfit.detect.dot_images import (
    BLURS,
    CELLS,
    MARGIN_PX,
    DotImages,
    cell_px_of,
    dot_images_about,
)
from lensfit.detect.observations import Observations
from lensfit.photograph import Photograph

_MIDDLE, _AROUND_MIDDLE = 0.3, 0.55
"""Radii of a dot between which blur shows if it reaches the middle."""
_EVEN = 0.95
"""How bright the ring around the middle is at least."""
_WHOLE = 1.35
"""Radii that hold all of a dot's light; what is farther out is its surround."""
_LEAST_RADIUS = 3.0
"""Cells: smaller dots have no middle to speak of."""
_FEWEST = 8
"""Dots that a diameter is computed from."""
DIAMETER_WIDTH = 0.03
"""Standard deviation of what is found, a share: a bound that is not computed. Drawn
discs come out within 1 %, and six photographs of one chart within 1 % of each other;
the spread of the dots and what `_EVEN` lets pass would give it."""


def dot_diameter_mm(
    marks: Observations, dot_images: DotImages, pitch_mm: tuple[float, float]
) -> float | None:
    """Median of the dots of one photograph; None where blur reaches their middles.

    Parameters
    ----------
    pitch_mm : Of the chart, to the right and down.
    """
    found = _measured_dots(marks, dot_images)
    of_cell = found.area_px2 / _lattice_cells_px2(marks)[dot_images.marks]
    of_cell = of_cell[found.even & found.whole & np.isfinite(of_cell)]
    if len(of_cell) < _FEWEST:
        return None
    return float(np.sqrt(4 / np.pi * np.median(of_cell) * pitch_mm[0] * pitch_mm[1]))


def even_in_the_middle(
    marks: Observations, dot_images: DotImages
) -> Bool[np.ndarray, " dots"]:
    """Whether a dot is broad and blur does not reach its middle, in green."""
    return _measured_dots(marks, dot_images).even


class _Measured(NamedTuple):
    """Area of every dot, whether it is broad and even in its middle, and whether all of
    it is on its dot image."""

    area_px2: Float[np.ndarray, " dots"]
    even: Bool[np.ndarray, " dots"]
    whole: Bool[np.ndarray, " dots"]


def _measured_dots(marks: Observations, dot_images: DotImages) -> _Measured:
    """In green."""
    light, cell = dot_images.light[:, 1], dot_images.cell_px
    valid = dot_images.valid[:, 1] & ~dot_images.clipped[:, 1]
    middle = (marks.points_px[dot_images.marks] - dot_images.corner_px) / cell
    along = np.arange(CELLS) + 0.5
    x = along[None, None, :] - middle[:, 0, None, None]
    y = along[None, :, None] - middle[:, 1, None, None]
    radius = marks.diameter_px[dot_images.marks, None, None] / (2 * cell)
    r = np.hypot(x, y) / radius
    surround = _median(light, valid & (r > _WHOLE))
    within = r <= _WHOLE
    lit = light - surround[:, None, None]
    bright = _median(lit, valid & (r < _MIDDLE))
    bright = np.where(bright > 0, bright, np.nan)
    ring = _median(lit, valid & (r > _MIDDLE) & (r < _AROUND_MIDDLE))
    whole = np.asarray((valid | ~within).all((1, 2)))
    area = np.sum(lit * within, (1, 2)) / bright * cell**2
    broad = radius[:, 0, 0] >= _LEAST_RADIUS
    return _Measured(area, broad & (ring > _EVEN * bright), whole)


def _median(
    light: Float[np.ndarray, "dots rows columns"],
    where: Float[np.ndarray, "dots rows columns"],
) -> Float[np.ndarray, " dots"]:
    """NaN where there is nothing."""
    chosen = np.where(where, light, np.nan).reshape(len(light), -1)
    some = np.isfinite(chosen).any(1)
    found = np.full(len(light), np.nan)
    found[some] = np.nanmedian(chosen[some], 1)
    return found


def _lattice_cells_px2(marks: Observations) -> Float[np.ndarray, " marks"]:
    """Area of a cell of the lattice at every mark that has neighbours on both sides."""
    lattice = np.round(marks.lattice).astype(int)
    first = lattice.min(0) - 1
    place = np.full(tuple(np.ptp(lattice, 0) + 3), -1)
    i, j = (lattice - first).T
    place[i, j] = np.arange(len(lattice))

    def across(di: int, dj: int) -> Float[np.ndarray, "marks 2"]:
        after, before = place[i + di, j + dj], place[i - di, j - dj]
        half = (marks.points_px[after] - marks.points_px[before]) / 2
        return np.where(((after >= 0) & (before >= 0))[:, None], half, np.nan)

    right, down = across(1, 0), across(0, 1)
    return np.abs(right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0])


_RIMS_OF_A_DOT, _MOST_WITH_RIMS = 4, 400
_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
_LEAST_EVEN = 0.5
"""Share of the dots whose middle blur leaves even."""


def cut_rims(
    photograph: Photograph, marks: Observations, whole: DotImages | None
) -> DotImages | None:
    """Dot images along the rims of large dots, in finer cells than the whole dots need.

    Parameters
    ----------
    whole : Of the same dots.

    Returns
    -------
    None of other marks, and where blur reaches the middle of dots or wants their cells.
    """
    if whole is None or marks.are_edges or whole.cell_px == 1:
        return None
    cell = cell_px_of(BLURS * _rim_blur_px(marks, whole) + MARGIN_PX)
    if cell >= whole.cell_px or np.mean(even_in_the_middle(marks, whole)) < _LEAST_EVEN:
        return None
    few = np.linspace(0, len(whole.marks) - 1, min(len(whole.marks), _MOST_WITH_RIMS))
    chosen = np.repeat(whole.marks[np.unique(few.astype(int))], _RIMS_OF_A_DOT)
    turn = np.arange(len(chosen)) * (2 * np.pi / _RIMS_OF_A_DOT)
    turn = turn + _GOLDEN_ANGLE * (np.arange(len(chosen)) // _RIMS_OF_A_DOT)
    radius_px = marks.diameter_px[chosen, None] / 2
    towards_px = radius_px * np.stack([np.cos(turn), np.sin(turn)], -1)
    middle_px = marks.points_px[chosen] + towards_px
    found = dot_images_about(
        photograph, marks, chosen, middle_px, cell, whole.pixel_noise
    )
    return replace(found, towards_px=towards_px)


def _rim_blur_px(marks: Observations, whole: DotImages) -> float:
    """Standard deviation of the blur across rims, median of the dots.

    Across an edge of contrast c, blurred by a Gaussian of deviation s, the squares of
    the slope add up to c^2 / (2 s sqrt(pi)) for every pixel along it.
    """
    light, use = whole.light[:, 1], whole.valid[:, 1]
    down, right = np.gradient(light, axis=(1, 2))
    inner = use[:, 1:-1, 1:-1] & use[:, 2:, 1:-1] & use[:, :-2, 1:-1]
    square = (down**2 + right**2)[:, 1:-1, 1:-1]
    square = np.sum(np.where(inner, square, 0.0), (1, 2))
    high, low = np.quantile(light, [0.95, 0.05], axis=(1, 2))
    along = np.pi * marks.diameter_px[whole.marks] / whole.cell_px
    blur = (high - low) ** 2 * along / (2 * np.sqrt(np.pi) * np.maximum(square, 1e-12))
    # Differences over two cells widen what is sharp: cells err to the coarse side.
    return float(np.median(blur)) * whole.cell_px

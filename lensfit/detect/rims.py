"""Pictures of the rims of large dots, in finer cells than whole dots would need.

What a large dot shows of the blur stands along its rim, and a dot image as large as the
dot has cells too coarse for it. Each dot is shown from four sides, turned from dot to
dot, so that edges of all directions are seen all over the frame.
"""

from dataclasses import replace

import numpy as np

from lensfit.detect.dot_diameter import even_in_the_middle
from lensfit.detect.dot_images import (
    BLURS,
    MARGIN_PX,
    DotImages,
    cell_px_of,
    dot_images_about,
)
from lensfit.detect.observations import Observations
from lensfit.photograph import Photograph

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

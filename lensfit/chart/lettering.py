"""Captions as outlines, so that a chart looks the same wherever it is opened.

The letters are DejaVu Sans, which comes with matplotlib.
"""

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from lensfit.chart.drawing import Outline

_FONT = FontProperties(family="DejaVu Sans")
_EM = 100.0


def lettered(
    text: str, left_mm: float, baseline_mm: float, size_mm: float, *, align: float = 0.0
) -> Outline:
    """A line of text.

    Parameters
    ----------
    size_mm : Height of the font's em.
    align : Part of the text's width that lies left of `left_mm`: 0, 0.5 or 1.
    """
    path = TextPath((0, 0), text, size=_EM, prop=_FONT)
    points = np.asarray(path.vertices, float) * [1.0, -1.0] * (size_mm / _EM)
    points[:, 0] -= align * width_per_em(text) * size_mm
    codes = np.asarray(path.codes, int)
    return Outline(points + np.array([left_mm, baseline_mm]), codes)


def width_per_em(text: str) -> float:
    """Width of a line of text, in heights of the font's em."""
    path = TextPath((0, 0), text, size=_EM, prop=_FONT)
    return float(np.asarray(path.vertices)[:, 0].max()) / _EM

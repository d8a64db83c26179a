"""The strokes of the report's figures, as inline SVG.

Hand-made rather than plotted by a library: the strokes take their colours from the
page's style sheet, so that one file serves light, dark and paper, and the same report
always gives the same bytes. Coordinates are the user units of the view box, x right,
y down.
"""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from lensfit.report.markup import Markup, tag

WIDTH = 560.0
HEIGHT = 350.0


@final
@dataclass(frozen=True)
class Figure:
    """A picture, what it is called, and what the reader should see in it."""

    key: str
    title: str
    svg: Markup
    caption: str


def drawing(label: str, *children: Markup, height: float = HEIGHT) -> Markup:
    """One SVG picture with a spoken label."""
    box = f"0 0 {WIDTH:g} {height:g}"
    return tag("svg", *children, viewBox=box, role="img", aria_label=label)


def path(
    x: Float[np.ndarray, " points"], y: Float[np.ndarray, " points"], class_: str
) -> Markup:
    """A line through points in view-box units, broken where a coordinate is NaN."""
    return tag("path", d=_path_data(x, y), class_=class_)


def words(
    x: float, y: float, text: str, class_: str, anchor: str, turn: str | None = None
) -> Markup:
    """A line of text at view-box units."""
    at = {"x": f"{x:.1f}", "y": f"{y:.1f}", "text_anchor": anchor}
    return tag("text", text, class_=class_, transform=turn, **at)


def _path_data(x: np.ndarray, y: np.ndarray) -> str:
    pieces, pen_down = [], False
    for px, py in zip(x.tolist(), y.tolist(), strict=True):
        if not (math.isfinite(px) and math.isfinite(py)):
            pen_down = False
            continue
        pieces.append(f"{'L' if pen_down else 'M'}{px:.1f} {py:.1f}")
        pen_down = True
    return "".join(pieces)

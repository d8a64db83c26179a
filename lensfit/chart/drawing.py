"""A drawing in black and white: layers of shapes in millimetres, exact.

x right, y down, origin at the top left corner of the sheet. A later layer covers
earlier ones; shapes of one layer do not overlap.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

BLACK, WHITE = 0.0, 1.0


def _no_discs() -> np.ndarray:
    return np.zeros((0, 3))


def _no_boxes() -> np.ndarray:
    return np.zeros((0, 4))


@dataclass(frozen=True, eq=False)
class Outline:
    """A filled outline of straight and curved pieces, as letters have.

    Attributes
    ----------
    codes : 1 moves, 2 draws a line, 3 a quadratic, 4 a cubic curve (each of its points
        carries the code), 79 closes; matplotlib's numbers.
    """

    points_mm: Float[np.ndarray, "points 2"]
    codes: Int[np.ndarray, " points"]


@dataclass(frozen=True, eq=False)
class Layer:
    """Shapes of one tone.

    Attributes
    ----------
    tone : `BLACK` or `WHITE`, scene-linear.
    discs_mm : Centre x, centre y, radius.
    boxes_mm : Left, top, width, height.
    outlines : Letters.
    """

    tone: float
    discs_mm: Float[np.ndarray, "discs 3"] = field(default_factory=_no_discs)
    boxes_mm: Float[np.ndarray, "boxes 4"] = field(default_factory=_no_boxes)
    outlines: tuple[Outline, ...] = ()


@dataclass(frozen=True, eq=False)
class Drawing:
    """A sheet and what is on it; its ground is of one tone."""

    width_mm: float
    height_mm: float
    ground: float
    layers: tuple[Layer, ...]
    title: str

"""The shapes of a pattern: discs, stripes or squares, and its orientation marks."""

import numpy as np
from jaxtyping import Float

from lensfit.chart.drawing import Layer
from lensfit.chart.pattern import LINE_END, Pattern


def pattern_layers(
    pattern: Pattern, origin_mm: tuple[float, float], ink: float, ground: float
) -> tuple[Layer, ...]:
    """What to draw, in order.

    Parameters
    ----------
    origin_mm : Place of lattice point (0, 0) on the sheet.
    ink, ground : Tones of marks and of what they lie on.
    """
    if pattern.kind == "dot-grid":
        return (Layer(ink, discs_mm=_dots(pattern, origin_mm)),)
    marks = pattern.orientation_marks * pattern.pitch_mm + origin_mm
    discs = _discs(marks, pattern.orientation_mark_mm)
    if pattern.kind == "line-grid":
        upright, level = _stripes(pattern, origin_mm)
        return (
            Layer(ink, boxes_mm=upright),
            Layer(ink, boxes_mm=level),
            Layer(ink, discs_mm=discs),
        )
    inked = _is_inked(pattern.orientation_marks)
    return (
        Layer(ink, boxes_mm=_squares(pattern, origin_mm)),
        Layer(ground, discs_mm=discs[inked]),
        Layer(ink, discs_mm=discs[~inked]),
    )


def lattice_points(pattern: Pattern) -> Float[np.ndarray, "points 2"]:
    """Lattice coordinates of all dots, crossings or inner corners, row by row."""
    columns, rows = pattern.lattice_size
    j, i = np.mgrid[:rows, :columns]
    return np.stack([i.ravel(), j.ravel()], -1).astype(float)


def _dots(pattern: Pattern, origin_mm: tuple[float, float]) -> np.ndarray:
    points = lattice_points(pattern)
    missing = (points[:, None] == pattern.orientation_marks).all(-1).any(-1)
    return _discs(points[~missing] * pattern.pitch_mm + origin_mm, pattern.mark_mm)


def _discs(centres_mm: np.ndarray, diameter_mm: float) -> np.ndarray:
    return np.column_stack([centres_mm, np.full(len(centres_mm), diameter_mm / 2)])


def _stripes(
    pattern: Pattern, origin_mm: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Upright and level lines."""
    families = []
    for axis in (0, 1):
        count, other = pattern.lattice_size[axis], pattern.lattice_size[1 - axis]
        boxes = np.empty((count, 4))
        boxes[:, axis] = np.arange(count) * pattern.pitch_mm - pattern.mark_mm / 2
        boxes[:, 1 - axis] = -LINE_END * pattern.pitch_mm
        boxes[:, :2] += origin_mm
        boxes[:, 2 + axis] = pattern.mark_mm
        boxes[:, 3 - axis] = (other - 1 + 2 * LINE_END) * pattern.pitch_mm
        families.append(boxes)
    return families[0], families[1]


def _squares(pattern: Pattern, origin_mm: tuple[float, float]) -> np.ndarray:
    j, i = np.mgrid[: pattern.rows, : pattern.columns]
    place = np.stack([i[(i + j) % 2 == 0], j[(i + j) % 2 == 0]], -1) - 1.0
    corner = place * pattern.pitch_mm + origin_mm
    return np.column_stack([corner, np.full_like(corner, pattern.pitch_mm)])


def _is_inked(sites: np.ndarray) -> np.ndarray:
    """Whether the square around a site is inked: the top left one of the board is."""
    return np.floor(sites + 1).sum(-1) % 2 == 0

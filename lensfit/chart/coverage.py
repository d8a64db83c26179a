"""Which part of every pixel a shape covers: in closed form, so edges lie where they do.

Pixel (column 0, row 0) covers [0, 1) x [0, 1). A disc's part of a pixel is a second
difference of the area of the disc left of and above a point; a box's is a product of
overlaps; a letter's follows from the areas to the right of its edges, cut at every
pixel border.
"""

import numpy as np
from jaxtyping import Float, Int
from matplotlib.path import Path as Curves

from lensfit.chart.drawing import Drawing, Layer, Outline

_FLATNESS = 32.0
"""Curves of letters are flattened at so many times the pixels' scale."""


def paint(drawing: Drawing, pixel_mm: float) -> Float[np.ndarray, "height width"]:
    """Mean tone of every pixel, scene-linear, float32.

    The first pixel's corner is the sheet's; the last column and row may show a part of
    a pixel more or less than the sheet, so that its scale is exact.

    Parameters
    ----------
    pixel_mm : Side of a pixel.
    """
    width, height = size_in_pixels(drawing, pixel_mm)
    scale = np.full(2, 1 / pixel_mm)
    picture = np.full((height, width), drawing.ground, np.float32)
    for layer in drawing.layers:
        covered = np.zeros((height, width), np.float32)
        _cover(covered, layer, scale)
        np.clip(covered, 0, 1, out=covered)
        picture += covered * (np.float32(layer.tone) - picture)
    return picture


def size_in_pixels(drawing: Drawing, pixel_mm: float) -> tuple[int, int]:
    """Width and height of a drawing, to the nearest whole pixel."""
    width = max(round(drawing.width_mm / pixel_mm), 1)
    return width, max(round(drawing.height_mm / pixel_mm), 1)


def _cover(covered: np.ndarray, layer: Layer, scale: np.ndarray) -> None:
    for left, top, wide, high in layer.boxes_mm:
        start = np.array([left, top]) * scale
        _add_box(covered, start, start + np.array([wide, high]) * scale)
    for x, y, radius in layer.discs_mm:
        _add_disc(covered, np.array([x, y]), radius, scale)
    for outline in layer.outlines:
        _add_outline(covered, outline, scale)


def _window(
    covered: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Borders of the pixels that a box touches, in x and y, and their view."""
    size = covered.shape[::-1]
    first = np.clip(np.floor(low).astype(int), 0, size)
    last = np.clip(np.ceil(high).astype(int), first, size)
    view = covered[first[1] : last[1], first[0] : last[0]]
    return np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1), view


def _add_box(covered: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
    x, y, view = _window(covered, low, high)
    across = np.diff(np.clip(x, low[0], high[0]))
    down = np.diff(np.clip(y, low[1], high[1]))
    view += np.outer(down, across).astype(np.float32)


def _add_disc(
    covered: np.ndarray, centre_mm: np.ndarray, radius_mm: float, scale: np.ndarray
) -> None:
    low, high = (centre_mm - radius_mm) * scale, (centre_mm + radius_mm) * scale
    x, y, view = _window(covered, low, high)
    at_x = x / scale[0] - centre_mm[0]
    at_y = y / scale[1] - centre_mm[1]
    area = disc_area(at_x[None, :], at_y[:, None], radius_mm) * scale.prod()
    view += np.diff(np.diff(area, axis=0), axis=1).astype(np.float32)


def disc_area(
    x: Float[np.ndarray, "*shape"], y: Float[np.ndarray, "*shape"], radius: float
) -> Float[np.ndarray, "*shape"]:
    """Area of the part of a disc about the origin with coordinates below (x, y).

    The integral over columns u < x of ``clip(y, -c, c) + c``, c half a column's chord:
    y + c inside the two places where c = |y|, outside them 2 c or nothing.
    """
    x = np.clip(x, -radius, radius)
    y = np.clip(y, -radius, radius)
    turn = np.sqrt(radius**2 - y**2)
    inside = np.clip(x, -turn, turn)
    area = y * (inside + turn) + _half_disc(inside, radius) - _half_disc(-turn, radius)
    before = _half_disc(np.minimum(x, -turn), radius)
    after = _half_disc(np.maximum(x, turn), radius) - _half_disc(turn, radius)
    return area + np.where(y > 0, 2 * (before + after), 0.0)


def _half_disc(x: np.ndarray, radius: float) -> np.ndarray:
    """Area of the upper half of a disc left of x."""
    chord = np.sqrt(np.maximum(radius**2 - x**2, 0))
    angle = np.arcsin(np.clip(x / radius, -1, 1)) + np.pi / 2
    return (x * chord + radius**2 * angle) / 2


def _add_outline(covered: np.ndarray, outline: Outline, scale: np.ndarray) -> None:
    curves = Curves(outline.points_mm * scale * _FLATNESS, outline.codes)
    rings = [np.asarray(r) / _FLATNESS for r in curves.to_polygons(closed_only=True)]
    if not rings:
        return
    points = np.concatenate(rings)
    x, y, view = _window(covered, points.min(0), points.max(0))
    if not view.size:
        return
    sums = np.zeros((view.shape[0], view.shape[1] + 2))
    for ring in rings:
        _add_edges(sums, ring - [x[0], y[0]])
    view += np.abs(np.cumsum(sums, axis=1)[:, :-2]).astype(np.float32)


def _add_edges(sums: Float[np.ndarray, "h w"], ring: Float[np.ndarray, "n 2"]) -> None:
    """Add what each edge changes in the covered area from one pixel to the next."""
    for start, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        cuts = [np.array([0.0, 1.0])]
        for a, b in zip(start, end, strict=True):
            between = np.arange(np.floor(min(a, b)) + 1, np.ceil(max(a, b)))
            cuts.append((between - a) / (b - a) if len(between) else between)
        at = np.unique(np.concatenate(cuts))
        points = start + at[:, None] * (end - start)
        middle = (points[1:] + points[:-1]) / 2
        down = np.diff(points[:, 1])
        cell: Int[np.ndarray, "pieces 2"] = np.floor(middle).astype(int)
        row = np.clip(cell[:, 1], 0, sums.shape[0] - 1)
        column = np.clip(cell[:, 0], 0, sums.shape[1] - 2)
        right = column + 1 - middle[:, 0]
        np.add.at(sums, (row, column), down * right)
        np.add.at(sums, (row, column + 1), down * (1 - right))

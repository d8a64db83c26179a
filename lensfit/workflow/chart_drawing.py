"""The chart as the fitted lens would photograph it, drawn on small pixels.

Only marks that were found are drawn, each where the model puts it. A drawing says how
much of every small pixel the marks cover (discs, lines, squares; smoothly at their
edges), or how much light falls there (dots whose blur was measured). Small pixels are
those of `small_photograph`.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from lensfit.detect.observations import POINT, Observations
from lensfit.workflow.dot_light import drawn_light
from lensfit.workflow.predicted_marks import PredictedMarks
from lensfit.workflow.small_photograph import SmallPhotograph

_PER_PX = 4
"""Points that a line or a square is made of, along each side of a small pixel."""
_SMALL_PX = 8
_GOLDEN = (5**0.5 - 1) / 2
_PROFILE_PX, _PROFILE_STEPS, _PROFILES = 12.0, 49, 400
_LEAST_RADIUS_PX = 0.35
_MOST_RADIUS_PX = 200.0


class Drawing(NamedTuple):
    """What the model expects, but for how bright it is.

    Attributes
    ----------
    marks : How much of each small pixel is mark, or how much light is there.
    inside : Small pixels among the marks.
    blurred : Whether the lens' own blur is in it.
    """

    marks: Float32[np.ndarray, "height width"]
    inside: Bool[np.ndarray, "height width"]
    blurred: bool


def drawing_of(
    seen: Observations,
    predicted: PredictedMarks,
    photograph: SmallPhotograph,
    kind: str,
    hole_diameter_mm: float | None,
) -> Drawing:
    """The marks of one photograph.

    Parameters
    ----------
    seen : The marks as found.
    predicted : Where the model puts them.
    photograph : On whose pixels to draw; lines take their width from it.
    kind : Of the target, as the shoot file says.
    hole_diameter_mm : Of a dot; None for the diameter seen.
    """
    scale, shape = np.asarray(photograph.scale), photograph.light.shape
    points = predicted.points_px * scale
    stretch = predicted.stretch_px * scale[:, None]
    gap_px = _gap_px(stretch, predicted.pitch_mm)
    of_lines = bool((seen.family != POINT).any())
    # Beyond its last sample a line goes on, and nothing would be drawn there.
    inside = _among(points, 0.0 if of_lines else gap_px, shape)
    if predicted.light is not None:
        light = drawn_light(predicted.light, seen.image_size_px)
        return Drawing(_averaged(light, shape), inside, True)
    if of_lines:
        normals = seen.normal * scale
        width = _line_width_px(photograph.light, points, normals, gap_px)
        marks = lines(points, seen, width, shape)
    elif kind in ("checkerboard", "charuco"):
        marks = squares(points, seen.lattice, shape)
    else:
        marks = discs(points, _radii(stretch, seen, scale, hole_diameter_mm), shape)
    return Drawing(marks, inside, False)


def discs(
    points: Float[np.ndarray, "marks 2"],
    radii: Float[np.ndarray, "marks 2 2"],
    shape: tuple[int, int],
) -> Float32[np.ndarray, "height width"]:
    """Ellipses: images of the unit circle under `radii`, each of its own area."""
    canvas = np.zeros(shape, np.float32)
    reach = int(np.ceil(np.abs(radii).sum(-1).max(initial=1.0))) + 1
    side, finer = 2 * reach + 2, 4 if reach < _SMALL_PX else 2
    corner = np.floor(points).astype(int) - reach
    grid = (np.arange(side * finer) + 0.5) / finer
    area = np.abs(np.linalg.det(radii))
    for first, turn, size, at in zip(
        corner, np.linalg.inv(radii), area, points, strict=True
    ):
        x, y = first[0] + grid - at[0], (first[1] + grid - at[1])[:, None]
        u, v = turn[0, 0] * x + turn[0, 1] * y, turn[1, 0] * x + turn[1, 1] * y
        fine = np.clip((1 - np.hypot(u, v)) * np.sqrt(size) * finer + 0.5, 0, 1)
        tile = fine.reshape(side, finer, side, finer).mean((1, 3))
        _add(canvas, tile * (np.pi * size / max(float(tile.sum()), 1e-9)), first)
    return np.minimum(canvas, 1.0)


def lines(
    points: Float[np.ndarray, "samples 2"],
    seen: Observations,
    width_px: float,
    shape: tuple[int, int],
) -> Float32[np.ndarray, "height width"]:
    """Ribbons through the samples of every line, of one width."""
    canvas = np.zeros(shape, np.float32)
    for family in (0, 1):
        mine = np.flatnonzero(seen.family == family)
        across, along = seen.lattice[mine, family], seen.lattice[mine, 1 - family]
        order = np.lexsort((along, across))
        mine, across = mine[order], across[order]
        ends = np.flatnonzero(np.diff(across)) + 1
        for line in np.split(mine, ends):
            if len(line) > 1:
                canvas += _ribbon(points[line], seen.normal[line], width_px, shape)
    return np.minimum(canvas, 1.0)


def squares(
    points: Float[np.ndarray, "corners 2"],
    lattice: Float[np.ndarray, "corners 2"],
    shape: tuple[int, int],
) -> Float32[np.ndarray, "height width"]:
    """Every other square whose four corners are known."""
    canvas = np.zeros(shape, np.float32)
    known = {(int(i), int(j)): k for k, (i, j) in enumerate(np.rint(lattice))}
    for i, j in known:
        around = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)]
        if (i + j) % 2 == 0 and all(corner in known for corner in around):
            corners = points[[known[corner] for corner in around]].reshape(2, 2, 2)
            _fill_square(canvas, corners)
    return np.minimum(canvas, 1.0)


def _radii(
    stretch: np.ndarray,
    seen: Observations,
    scale: np.ndarray,
    hole_diameter_mm: float | None,
) -> np.ndarray:
    """Half axes of every dot's ellipse: of the hole, or as large as dots look."""
    if hole_diameter_mm is not None:
        return stretch * hole_diameter_mm / 2
    looks = float(np.nanmedian(seen.diameter_px)) / 2 * np.sqrt(scale[0] * scale[1])
    usual = np.sqrt(np.median(np.abs(np.linalg.det(stretch))))
    radius = np.clip(np.nan_to_num(looks), _LEAST_RADIUS_PX, _MOST_RADIUS_PX)
    return stretch * (radius / usual)


def _gap_px(stretch: np.ndarray, pitch_mm: tuple[float, float]) -> float:
    """From mark to mark, the shorter way of the target, as a rule."""
    return min(pitch_mm) * float(np.sqrt(np.median(np.abs(np.linalg.det(stretch)))))


def _among(points: np.ndarray, gap_px: float, shape: tuple[int, int]) -> np.ndarray:
    """The convex hull of the marks, and half a gap around it."""
    hull = cv2.convexHull(points.astype(np.float32))
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(hull).astype(np.int32)], (1,))
    side = 2 * max(round(gap_px / 2), 1) + 1
    return cv2.dilate(mask, np.ones((side, side), np.uint8)) > 0


def _line_width_px(
    light: np.ndarray, points: np.ndarray, normals: np.ndarray, gap_px: float
) -> float:
    """Of the profile across the lines, as far as half way to the next, its area over
    its height."""
    chosen = np.linspace(0, len(points) - 1, min(len(points), _PROFILES)).astype(int)
    reach = min(_PROFILE_PX, 0.45 * gap_px)
    steps = np.linspace(-reach, reach, _PROFILE_STEPS)
    unit = normals[chosen] / np.linalg.norm(normals[chosen], axis=-1, keepdims=True)
    # OpenCV counts from the middle of the first pixel.
    at = points[chosen, None] + steps[None, :, None] * unit[:, None] - 0.5
    x, y = np.moveaxis(at.astype(np.float32), -1, 0)
    found = cv2.remap(light.astype(np.float32), x, y, cv2.INTER_LINEAR)
    profile = np.median(found, axis=0)
    contrast = profile - (profile[0] + profile[-1]) / 2
    height = contrast[len(steps) // 2]
    area = contrast.sum() * (steps[1] - steps[0])
    width = area / height if height else 1.0
    return float(np.clip(width, 2 * _LEAST_RADIUS_PX, 2 * reach))


def _ribbon(
    points: np.ndarray, normals: np.ndarray, width_px: float, shape: tuple[int, int]
) -> np.ndarray:
    """A line through points, of dealt points set off from place to place."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    count = max(2, round(float(length[-1]) * _PER_PX))
    at = (np.arange(count) + 0.5) / count * length[-1]
    same_side = normals * np.sign(normals @ normals[0])[:, None]
    middle, aside = (
        np.stack([np.interp(at, length, part) for part in of_samples.T], -1)
        for of_samples in (points, same_side)
    )
    rows = max(2, round(width_px * _PER_PX))
    share = (np.arange(rows) + np.mod(np.arange(count) * _GOLDEN, 1.0)[:, None]) / rows
    across = (share - 0.5) * width_px
    dealt = middle[:, None] + across[..., None] * aside[:, None]
    area = width_px * float(length[-1]) / dealt[..., 0].size
    return _dealt(dealt.reshape(-1, 2), np.full(dealt[..., 0].size, area), shape)


def _fill_square(canvas: np.ndarray, corners: Float[np.ndarray, "2 2 2"]) -> None:
    """A square between corners [down, across], by the finer pixels inside."""
    outline = corners.reshape(4, 2)[[0, 1, 3, 2]]
    low = np.floor(outline.min(0)).astype(int)
    width, height = np.ceil(outline.max(0)).astype(int) - low
    x = low[0] + (np.arange(width * _PER_PX) + 0.5) / _PER_PX
    y = (low[1] + (np.arange(height * _PER_PX) + 0.5) / _PER_PX)[:, None]
    beside = [
        (x - a[0]) * (b[1] - a[1]) - (y - a[1]) * (b[0] - a[0])
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True)
    ]
    inside = np.all([one > 0 for one in beside], 0) | np.all(
        [one < 0 for one in beside], 0
    )
    tile = inside.reshape(height, _PER_PX, width, _PER_PX).mean((1, 3))
    _add(canvas, tile, low)


def _dealt(
    points: np.ndarray, area: np.ndarray, shape: tuple[int, int]
) -> Float32[np.ndarray, "height width"]:
    """Area that falls on every pixel."""
    column, row = np.floor(points).astype(int).T
    height, width = shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    at = (row * width + column)[inside]
    found = np.bincount(at, area[inside], minlength=width * height)
    return found.reshape(shape).astype(np.float32)


def _averaged(canvas: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    size = shape[1], shape[0]
    return cv2.resize(canvas, size, interpolation=cv2.INTER_AREA).astype(np.float32)


def _add(canvas: np.ndarray, tile: np.ndarray, corner: np.ndarray) -> None:
    """Add a tile whose first pixel is at a corner, as far as it lies on the canvas."""
    (x, y), (height, width) = corner, tile.shape
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, canvas.shape[1]), min(y + height, canvas.shape[0])
    if x1 > x0 and y1 > y0:
        canvas[y0:y1, x0:x1] += tile[y0 - y : y1 - y, x0 - x : x1 - x]

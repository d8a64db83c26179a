"""Coverage of small pixels by discs, lines and squares.

Pixel (column 0, row 0) covers [0, 1) x [0, 1). Edges are smooth: coverage is counted on
finer pixels, or on jittered points.
"""

import numpy as np
from jaxtyping import Float, Float32

from lensfit.detect.observations import Observations

_PER_PX = 4
"""Points that a line or a square is made of, along each side of a small pixel."""
_GOLDEN = (5**0.5 - 1) / 2
_SMALL_PX = 8


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


def _ribbon(
    points: np.ndarray, normals: np.ndarray, width_px: float, shape: tuple[int, int]
) -> np.ndarray:
    """A line through points, of points jittered from place to place."""
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
    samples = middle[:, None] + across[..., None] * aside[:, None]
    area = width_px * float(length[-1]) / samples[..., 0].size
    areas = np.full(samples[..., 0].size, area)
    return _area_per_pixel(samples.reshape(-1, 2), areas, shape)


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


def _area_per_pixel(
    points: np.ndarray, area: np.ndarray, shape: tuple[int, int]
) -> Float32[np.ndarray, "height width"]:
    """Area that falls on every pixel."""
    column, row = np.floor(points).astype(int).T
    height, width = shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    at = (row * width + column)[inside]
    found = np.bincount(at, area[inside], minlength=width * height)
    return found.reshape(shape).astype(np.float32)


def _add(canvas: np.ndarray, tile: np.ndarray, corner: np.ndarray) -> None:
    """Add a tile whose first pixel is at a corner, as far as it lies on the canvas."""
    (x, y), (height, width) = corner, tile.shape
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + width, canvas.shape[1]), min(y + height, canvas.shape[0])
    if x1 > x0 and y1 > y0:
        canvas[y0:y1, x0:x1] += tile[y0 - y : y1 - y, x0 - x : x1 - x]

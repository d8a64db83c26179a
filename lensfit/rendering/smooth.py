"""Evaluate a smooth function at every pixel by Chebyshev interpolation in blocks.

A lens map is analytic almost everywhere, so a block of picture is described by its
values at a few Chebyshev nodes; the interpolant is then two small matrix products.
Every block is checked at points between its nodes. A block that misses the tolerance,
or that crosses the edge of what the lens can invert (NaN), is divided into four and
tried again, and a block of a few pixels is evaluated directly. A smooth lens map needs
some thousand evaluations for a frame of eight million pixels.

Reference: L. N. Trefethen, Approximation Theory and Approximation Practice (2013),
chapters 5 (barycentric interpolation) and 8 (geometric convergence).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.batches import in_batches
from lensfit.coords import Window

FIRST_NODES, LATER_NODES = 24, 10
SMALLEST_BLOCK_PX = 16

PointFunction = Callable[
    [Float[np.ndarray, "points 2"]], Float[np.ndarray, "points values"]
]


def smooth_over_window(
    function: PointFunction, window: Window, tolerance: float
) -> Float[np.ndarray, "values height width"]:
    """`function` at every pixel centre of `window`, to within `tolerance`.

    Parameters
    ----------
    function : Values at (x, y) in pixels; NaN where it has none.
    window : Pixels wanted.
    tolerance : Largest error, in the unit of the values, that is accepted at the
        points between the nodes.

    Returns
    -------
    float64, one plane per value.
    """
    axis, blocks, small = _FIRST, [window], []
    planes = None
    while blocks:
        at_nodes, at_checks = _evaluate_blocks(function, blocks, axis)
        if planes is None:
            planes = np.empty((at_nodes.shape[-1], window.height, window.width))
        failed = [
            block
            for block, nodes, checks in zip(blocks, at_nodes, at_checks, strict=True)
            if not _fill(_view(planes, window, block), nodes, checks, tolerance, axis)
        ]
        parts = [part for block in failed for part in _quarters(block)]
        small += [part for part in parts if _is_small(part)]
        blocks = [part for part in parts if not _is_small(part)]
        axis = _LATER
    assert planes is not None
    _fill_directly(planes, window, function, small)
    return planes


class _Axis(NamedTuple):
    """Chebyshev nodes on [-1, 1], the points between them and the way from one to
    the other."""

    nodes: np.ndarray
    checks: np.ndarray
    checks_from_nodes: np.ndarray


def _barycentric_matrix(nodes: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Values at `wanted` from values at the Chebyshev points of the second kind."""
    weights = (-1.0) ** np.arange(len(nodes))
    weights[[0, -1]] /= 2
    gap = wanted[:, None] - nodes
    exact = gap == 0
    quotient = weights / np.where(exact, 1.0, gap)
    matrix = quotient / quotient.sum(1, keepdims=True)
    return np.where(exact.any(1, keepdims=True), exact, matrix)


def _make_axis(count: int) -> _Axis:
    angle = np.pi * np.arange(count) / (count - 1)
    nodes, checks = -np.cos(angle), -np.cos(angle[:-1] + angle[1] / 2)
    return _Axis(nodes, checks, _barycentric_matrix(nodes, checks))


_FIRST, _LATER = _make_axis(FIRST_NODES), _make_axis(LATER_NODES)


def _evaluate_blocks(function: PointFunction, blocks: list[Window], axis: _Axis):
    """Values at the nodes and at the check points of every block."""
    node_points = [_points(block, axis.nodes) for block in blocks]
    check_points = [_points(block, axis.checks) for block in blocks]
    n = len(axis.nodes)
    values = in_batches(function, np.concatenate(node_points + check_points))
    split = len(blocks) * n**2
    count = values.shape[-1]
    return (
        values[:split].reshape(-1, n, n, count),
        values[split:].reshape(-1, n - 1, n - 1, count),
    )


def _points(block: Window, unit: np.ndarray) -> np.ndarray:
    """(x, y) px of a tensor grid that spans the pixel centres of a block."""
    x = block.x_min + 0.5 + (unit + 1) / 2 * (block.width - 1)
    y = block.y_min + 0.5 + (unit + 1) / 2 * (block.height - 1)
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def _fill(
    target: np.ndarray,
    nodes: np.ndarray,
    checks: np.ndarray,
    tolerance: float,
    axis: _Axis,
) -> bool:
    """Fill a block from its nodes; False if that would miss the tolerance."""
    if np.isnan(nodes).all() and np.isnan(checks).all():
        target[:] = np.nan
        return True
    between = axis.checks_from_nodes
    # Constants come through exactly, whatever the rounding of the weights.
    centre = nodes[len(nodes) // 2, len(nodes) // 2]
    deviation = np.moveaxis(nodes - centre, -1, 0)
    predicted = between @ deviation @ between.T + centre[:, None, None]
    error = np.abs(predicted - np.moveaxis(checks, -1, 0)).max()
    if not error <= tolerance:  # NaN fails too
        return False
    rows = _pixels_from_nodes(axis, target.shape[1])
    columns = _pixels_from_nodes(axis, target.shape[2])
    target[:] = rows @ deviation @ columns.T + centre[:, None, None]
    return True


def _pixels_from_nodes(axis: _Axis, count: int) -> np.ndarray:
    """Interpolation from the nodes of an axis to its `count` pixel centres."""
    return _barycentric_matrix(axis.nodes, np.linspace(-1.0, 1.0, count))


def _fill_directly(
    planes: np.ndarray, window: Window, function: PointFunction, blocks: list[Window]
) -> None:
    """Evaluate every pixel of the blocks, all in one go."""
    if not blocks:
        return
    points = [block.pixel_centres().reshape(-1, 2) for block in blocks]
    values = in_batches(function, np.concatenate(points)).T
    ends = np.cumsum([len(part) for part in points])
    for block, part in zip(blocks, np.split(values, ends[:-1], axis=1), strict=True):
        target = _view(planes, window, block)
        target[:] = part.reshape(target.shape)


def _is_small(block: Window) -> bool:
    return max(block.width, block.height) <= SMALLEST_BLOCK_PX


def _quarters(block: Window) -> list[Window]:
    """The block cut at its middle along each side longer than the smallest block."""
    x_cuts = _blocks_of(block.x_min, block.x_max)
    y_cuts = _blocks_of(block.y_min, block.y_max)
    return [Window(x0, y0, x1, y1) for y0, y1 in y_cuts for x0, x1 in x_cuts]


def _blocks_of(low: int, high: int) -> list[tuple[int, int]]:
    if high - low + 1 <= SMALLEST_BLOCK_PX:
        return [(low, high)]
    middle = (low + high) // 2
    return [(low, middle), (middle + 1, high)]


def _view(planes: np.ndarray, window: Window, block: Window) -> np.ndarray:
    top, left = block.y_min - window.y_min, block.x_min - window.x_min
    return planes[:, top : top + block.height, left : left + block.width]

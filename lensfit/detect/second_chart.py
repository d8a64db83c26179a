"""Two charts in one photograph whose lattices happen to join, and which is the larger.

Along a row of one flat chart the step from point to point changes smoothly: two steps
on either side predict it but for the third difference of the row. Where one chart ends
and another begins, by its side or behind it, the step between them is any: the seam.
Points are joined wherever a step agrees with those beside it; two large parts with
nothing but contradicting steps between them are two charts.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from lensfit.detect.lattice_growth import STEPS, Board

_OFF_STEP = 0.03
"""Of a step, by which one that agrees may differ at least."""
_USUAL_TIMES = 8.0
"""The same in usual differences of this photograph, which distortion and noise make."""
_WIDEST_GAP = 5
"""Steps to the next point of a row or column; a seam takes the points beside it."""
_FEWEST_POINTS = 9
_LEAST_PART = 0.1
"""Of the larger chart's points."""
_FEWEST_CONTRADICTIONS = 3


class _Steps(NamedTuple):
    """Steps between points next to each other in a row or column.

    Attributes
    ----------
    start, end : The points.
    bend : Of the two steps before and of the two after: how much they differ.
    off : Difference of the step from what those predict; relative, as `bend`, and NaN
        where they are missing.
    """

    start: Int[np.ndarray, " steps"]
    end: Int[np.ndarray, " steps"]
    bend: Float[np.ndarray, "2 steps"]
    off: Float[np.ndarray, "2 steps"]


def larger_chart(
    cells: Int[np.ndarray, "points 2"], points_px: Float[np.ndarray, "points 2"]
) -> Bool[np.ndarray, " points"] | None:
    """The points of the larger of two charts; None where there is one.

    Parameters
    ----------
    cells : Cells in which neighbouring points are one step apart.
    """
    steps = _steps_of_board(cells, points_px)
    # Two steps of which one crosses a seam predict nothing.
    off = np.where(steps.bend < _limit(steps.bend), steps.off, np.nan)
    tested = np.isfinite(off).any(0)
    if not tested.any():
        return None
    agrees = tested & (np.nan_to_num(off) < _limit(off)).all(0)
    pairs = steps.start[agrees], steps.end[agrees]
    graph = coo_array((np.ones(len(pairs[0])), pairs), shape=(len(cells), len(cells)))
    part = connected_components(graph, directed=False)[1]
    sizes = np.bincount(part)
    if len(sizes) < 2:
        return None
    larger, smaller = np.argsort(-sizes, kind="stable")[:2]
    if sizes[smaller] < max(_FEWEST_POINTS, _LEAST_PART * sizes[larger]):
        return None
    ends = np.sort(np.stack([part[steps.start], part[steps.end]]), axis=0)
    seam = tested & (ends == np.sort([[larger], [smaller]], axis=0)).all(0)
    if np.count_nonzero(seam) < _FEWEST_CONTRADICTIONS:
        return None
    return part == larger


def _limit(differences: np.ndarray) -> float:
    """Up to which differences are those of one chart."""
    known = differences[np.isfinite(differences)]
    usual = float(np.median(known)) if known.size else 0.0
    return max(_OFF_STEP, _USUAL_TIMES * usual)


def _steps_of_board(cells: np.ndarray, points_px: np.ndarray) -> _Steps:
    """All steps along rows and columns."""
    board = Board(len(cells))
    board.place(np.arange(len(cells)), cells)
    padded = np.concatenate([points_px, np.full((1, 2), np.nan)])
    return _joined_steps([_steps_along(board, padded, axis) for axis in (0, 1)])


def _steps_along(board: Board, padded: np.ndarray, axis: int) -> _Steps:
    """Steps along rows (axis 0) or columns; `padded` ends in a point of NaN."""
    step, waiting, found = STEPS[axis], np.arange(len(board.cells)), []
    for gap in range(1, _WIDEST_GAP + 1):
        ahead = board.at(board.cells[waiting] + gap * step)
        there = ahead >= 0
        start, end = waiting[there], ahead[there]
        waiting = waiting[~there]
        one = (padded[end] - padded[start]) / gap
        sides = [
            _next_two_steps(board, padded, start, -step),
            _next_two_steps(board, padded, end, step),
        ]
        bend, off = [], []
        for near, far in sides:
            length = np.linalg.norm(near, axis=1)
            # From the middle of the nearer step to the middle of the gap.
            predicted = near + (near - far) * (gap + 1) / 2
            bend.append(np.linalg.norm(near - far, axis=1) / length)
            off.append(np.linalg.norm(one - predicted, axis=1) / length)
        found.append(_Steps(start, end, np.stack(bend), np.stack(off)))
    return _joined_steps(found)


def _next_two_steps(
    board: Board, padded: np.ndarray, points: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The two steps before points (after them, of a step forwards), the nearer first,
    both along the row; NaN where one is missing."""
    cells, forwards = board.cells[points], step.sum()
    place = [padded[board.at(cells + k * step)] for k in (0, 1, 2)]
    return forwards * (place[1] - place[0]), forwards * (place[2] - place[1])


def _joined_steps(parts: list[_Steps]) -> _Steps:
    return _Steps(*(np.concatenate(one, axis=-1) for one in zip(*parts, strict=True)))

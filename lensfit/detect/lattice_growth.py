"""Growing a lattice over points, one wave front at a time, from neighbour to neighbour.

A `Board` holds which point sits on which integer cell. Its numbers are the seed's own:
any two short independent steps of the lattice serve as a basis here, and the caller
turns them upright afterwards. Every step below is one array operation over a whole
wave front, so that 20,000 points take about a hundred steps.
"""

from typing import NamedTuple, final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree


def nearest(
    tree: KDTree, points_px: Float[np.ndarray, "points 2"], count: int
) -> tuple[Float[np.ndarray, "points count"], Int[np.ndarray, "points count"]]:
    """Distances and indices of the nearest points of a tree, nearest first.

    Parameters
    ----------
    tree : The points to look among.
    points_px : Where to look from.
    count : How many to find; two or more, so that the result has two axes.
    """
    distance, index = tree.query(points_px, k=count)
    return np.asarray(distance), np.asarray(index)


STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
"""The four neighbours of a cell, each a quarter turn after the one before."""

_NEIGHBOURS = 10
_OPPOSITE_TOLERANCE = 0.2
_LARGE_CELL = 1.4
"""Steps whose squares sum to this much more than those about them skip a point."""
_ACCEPT = 0.28
"""Largest distance from the predicted place, in steps: below the half step at which
two cells would compete, above what distortion bends within one step."""
_UNAMBIGUOUS = 0.6
"""Nearest candidate must be this much nearer than the second."""


class Neighbourhoods(NamedTuple):
    """What each point's nearest neighbours look like.

    regular : Two pairs of neighbours lie opposite each other, in two directions.
    roughness : How far the pairs are from being opposite, relative to their length,
        averaged over the neighbours; inf where irregular.
    cross : The points at +a, -a, +b, -b.
    """

    regular: Bool[np.ndarray, " points"]
    roughness: Float[np.ndarray, " points"]
    cross: Int[np.ndarray, "points 4"]


def neighbourhoods(
    points_px: Float[np.ndarray, "points 2"], tree: KDTree
) -> Neighbourhoods:
    """Find, for each point, the two shortest pairs of opposite neighbours.

    In a lattice the two shortest independent steps always form a basis.
    """
    count = min(_NEIGHBOURS + 1, len(points_px))
    near = nearest(tree, points_px, count)[1][:, 1:]
    step = points_px[near] - points_px[:, None]
    length = np.maximum(np.linalg.norm(step, axis=-1), 1e-9)
    miss = np.linalg.norm(step[:, :, None] + step[:, None], axis=-1)
    miss /= (length[:, :, None] + length[:, None]) / 2
    partner = miss.argmin(2)
    miss = np.take_along_axis(miss, partner[..., None], 2)[..., 0]
    paired = miss < _OPPOSITE_TOLERANCE
    rows = np.arange(len(points_px))
    first = paired.argmax(1)
    a = step[rows, first] / length[rows, first, None]
    sine = np.abs(a[:, None, 0] * step[..., 1] - a[:, None, 1] * step[..., 0]) / length
    across = paired & (sine > 0.3)
    second = across.argmax(1)
    regular = paired.any(1) & across.any(1)
    regular &= length[rows, second] < 3 * length[rows, first]
    chosen = np.stack([first, partner[rows, first], second, partner[rows, second]], 1)
    size = length[rows, first] ** 2 + length[rows, second] ** 2
    regular &= ~(size > _LARGE_CELL * _lower_quartile(size, regular, near))
    own = np.where(regular, miss[rows, first] + miss[rows, second], 1.0)
    roughness = np.where(regular, own + own[near[:, :8]].mean(1), np.inf)
    cross = np.take_along_axis(near, chosen, 1)
    return Neighbourhoods(regular, roughness, cross)


def _lower_quartile(size, regular, near):
    """Lower quartile of the cell sizes about each point; NaN where none is known."""
    around = np.where(regular, size, np.nan)[near]
    known = np.isfinite(around).sum(1)
    return np.sort(around, axis=1)[np.arange(len(size)), known // 4]


@final
class Board:
    """Which point sits on which cell; grows as cells are placed."""

    FREE = -(1 << 30)

    def __init__(self, points: int):
        self.cells = np.full((points, 2), self.FREE)
        self._grid = np.full((65, 65), -1)
        self._origin = np.array([32, 32])

    @property
    def is_member(self) -> Bool[np.ndarray, " points"]:
        """Whether each point sits on a cell."""
        return self.cells[:, 0] != self.FREE

    def at(self, cells: Int[np.ndarray, "*shape 2"]) -> Int[np.ndarray, "*shape"]:
        """The point on each cell, -1 where there is none."""
        place = cells + self._origin
        inside = np.all((place >= 0) & (place < self._grid.shape), axis=-1)
        place = np.where(inside[..., None], place, 0)
        return np.where(inside, self._grid[place[..., 0], place[..., 1]], -1)

    def place(
        self, points: Int[np.ndarray, " m"], cells: Int[np.ndarray, "m 2"]
    ) -> None:
        """Put points on cells, which must be free."""
        if not len(points):
            return
        self._make_room(cells)
        self.cells[points] = cells
        place = cells + self._origin
        self._grid[place[:, 0], place[:, 1]] = points

    def keep_only(self, keep: Bool[np.ndarray, " points"]) -> None:
        """Free the cells of all other points."""
        dropped = self.cells[self.is_member & ~keep] + self._origin
        self._grid[dropped[:, 0], dropped[:, 1]] = -1
        self.cells[~keep] = self.FREE

    def on_basis(self, matrix: Int[np.ndarray, "2 2"]) -> "Board":
        """The same members on cells counted in another basis."""
        board = Board(len(self.cells))
        members = np.flatnonzero(self.is_member)
        board.place(members, np.rint(self.cells[members] @ matrix.T).astype(int))
        return board

    def _make_room(self, cells):
        place = cells + self._origin
        before = max(0, -int(place.min()))
        after = max(0, int((place - self._grid.shape).max()) + 1)
        if before or after:
            before, after = (before + 64, after + 64)
            self._grid = np.pad(self._grid, (before, after), constant_values=-1)
            self._origin = self._origin + before

    def jacobians(
        self, points_px: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 2 2"]:
        """d px / d cell at every point, columns along the two axes; NaN if unknown."""
        out = np.full((len(points_px), 2, 2), np.nan)
        member = np.flatnonzero(self.is_member)
        position = _position(self, points_px)
        here = points_px[member]
        for axis in (0, 1):
            ahead = position(self.cells[member] + STEPS[axis])
            behind = position(self.cells[member] - STEPS[axis])
            step = np.where(np.isfinite(ahead), ahead - here, here - behind)
            both = np.isfinite(ahead) & np.isfinite(behind)
            out[member, :, axis] = np.where(both, (ahead - behind) / 2, step)
        return out


def predictions(
    board: Board, points_px: np.ndarray, cells: Int[np.ndarray, "m 2"]
) -> tuple[Float[np.ndarray, "guesses m 2"], Float[np.ndarray, " m"]]:
    """Where the point of each cell should be, by each of its neighbours' rules.

    Straight on from two cells in a row, the fourth corner of a parallelogram, and
    midway between opposite neighbours; NaN where the neighbours are missing. Also the
    distance to the nearest of the four neighbours.
    """
    position = _position(board, points_px)
    one = [position(cells + step) for step in STEPS]
    two = [position(cells + 2 * step) for step in STEPS]
    guesses = [2 * one[k] - two[k] for k in range(4)]
    for k in range(4):
        corner = position(cells + STEPS[k] + STEPS[(k + 1) % 4])
        guesses.append(one[k] + one[(k + 1) % 4] - corner)
    guesses += [(one[0] + one[2]) / 2, (one[1] + one[3]) / 2]
    guesses = np.stack(guesses)
    middle = _nanmean(guesses)
    reach = np.linalg.norm(np.stack(one) - middle, axis=-1)
    reach = np.where(np.isfinite(reach), reach, np.inf).min(0)
    return guesses, np.where(np.isfinite(reach), reach, np.nan)


def grow(board: Board, points_px: Float[np.ndarray, "points 2"], tree: KDTree) -> None:
    """Let the lattice spread until no cell beside it finds its point.

    A front that dies out is restarted once from the whole boundary, where cells that
    had too few neighbours may have gained some.
    """
    front = board.cells[board.is_member]
    whole = True
    while len(front) or not whole:
        whole = not len(front)
        if whole:
            front = board.cells[board.is_member]
        cells = np.unique((front[:, None] + STEPS).reshape(-1, 2), axis=0)
        cells = cells[board.at(cells) < 0]
        guesses, reach = predictions(board, points_px, cells)
        guess = _nanmean(guesses)
        known = np.isfinite(guess).all(1) & np.isfinite(reach)
        cells, guess, reach = cells[known], guess[known], reach[known]
        if not len(cells):
            front = cells
            continue
        distance, found = nearest(tree, guess, 2)
        accept = distance[:, 0] < _ACCEPT * reach
        accept &= distance[:, 0] < _UNAMBIGUOUS * distance[:, 1]
        accept &= ~board.is_member[found[:, 0]]
        order = np.flatnonzero(accept)[np.argsort(distance[accept, 0])]
        points, first = np.unique(found[order, 0], return_index=True)
        front = cells[order[first]]
        board.place(points, front)


def _position(board: Board, points_px: np.ndarray):
    """A function from cells to positions, NaN where no point sits."""
    padded = np.concatenate([points_px, np.full((1, 2), np.nan)])
    return lambda cells: padded[board.at(cells)]


def _nanmean(values: np.ndarray) -> np.ndarray:
    """Mean over the first axis, ignoring NaN; NaN where nothing is known."""
    known = np.isfinite(values)
    total = np.where(known, values, 0).sum(0)
    count = known.sum(0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)

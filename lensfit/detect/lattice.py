"""Which dot is which: integer lattice indices of points on a bent, partly seen grid.

The points may come from any doubly periodic target (dots, corners, line crossings)
seen under perspective and strong distortion, with points missing and false points
among them. Nothing global is assumed; neighbouring cells only have to be alike. From
the most regular neighbourhood the lattice grows in wave fronts: every free cell beside
the front predicts its point by extrapolating its indexed neighbours, and takes the
nearest point if that is near enough. Points that then disagree with their
surroundings are freed, seams are cut, and gaps are bridged by a local quadratic map.

A point is consistent if the median of what its neighbours predict for it is near it; a
seam (two parts grown around a hole, one step out of register) shows as neighbours on
the board that are not one step apart in the picture, and is cut. Gaps wider than the
growth can step over are crossed by a local quadratic map from pixels to cells.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from lensfit.detect.lattice_growth import (
    STEPS,
    Board,
    grow,
    nearest,
    neighbourhoods,
    predictions,
)

_OFF_PLACE = 0.2
"""Largest deviation from the neighbours' prediction, in steps."""
_ROUNDS = 6
_OFF_STEP = 0.4
"""Largest deviation of one step from the steps around it."""
_WIDEST_GAP = 5
"""Steps to the next point of a row or column that still connects."""
_BRIDGE_NEIGHBOURS = 20
_BRIDGE_REACH = 4.5
"""Widest gap to cross, in steps."""
_BRIDGE_NEAR = 2.3
_BRIDGE_OFF = 0.2
_BRIDGE_DOUBT = 0.1
"""Largest standard deviation of the bridged cell, in steps."""
_BRIDGE_BEND = 0.6
"""Largest difference between the quadratic map and an affine one, in steps."""
_LEAST_SPREAD = 0.01


def deviations(board: Board, points_px: np.ndarray) -> Float[np.ndarray, " points"]:
    """How far each indexed point is from what its neighbours predict, in steps.

    NaN for points without a prediction, and for those that are not indexed.
    """
    out = np.full(len(points_px), np.nan)
    member = np.flatnonzero(board.is_member)
    guesses, reach = predictions(board, points_px, board.cells[member])
    off = np.linalg.norm(nanmedian(guesses) - points_px[member], axis=1)
    out[member] = off / reach
    return out


def consistent_members(
    board: Board, points_px: Float[np.ndarray, "points 2"]
) -> Bool[np.ndarray, " points"]:
    """Members that fit their surroundings, in the largest seamless part."""
    board = board.on_basis(np.eye(2, dtype=int))
    for _ in range(_ROUNDS):
        off = deviations(board, points_px) > _OFF_PLACE
        if not off.any():
            break
        board.keep_only(~off)
    keep = board.is_member
    start, end = _sound_steps(board, points_px, keep)
    graph = coo_array(
        (np.ones(len(start)), (start, end)), shape=(len(points_px), len(points_px))
    )
    part = connected_components(graph, directed=False)[1]
    sizes = np.bincount(part[keep], minlength=1)
    return keep & (part == sizes.argmax())


def _sound_steps(board: Board, points_px, keep):
    """Pairs of neighbours on the board that lie so in the picture too.

    Across a gap the next point of the row or column counts as a neighbour.
    """
    jacobian = board.jacobians(points_px)
    member = np.flatnonzero(keep)
    starts, ends = [], []
    for axis in (0, 1):
        waiting = member
        for reach in range(1, _WIDEST_GAP + 1):
            ahead = board.at(board.cells[waiting] + reach * STEPS[axis])
            there = (ahead >= 0) & keep[ahead]
            start, end = waiting[there], ahead[there]
            waiting = waiting[~there]
            near = jacobian[start, :, axis], jacobian[end, :, axis]
            if reach == 1:
                near += tuple(
                    _step_beside(board, points_px, start, axis, s) for s in (1, -1)
                )
            usual = nanmedian(np.stack(near))
            off = points_px[end] - points_px[start] - reach * usual
            limit = _OFF_STEP * np.linalg.norm(usual, axis=1)
            sound = ~(np.linalg.norm(off, axis=1) > limit)
            starts.append(start[sound])
            ends.append(end[sound])
    return np.concatenate(starts), np.concatenate(ends)


def _step_beside(board: Board, points_px, start, axis: int, side: int) -> np.ndarray:
    """The parallel step one cell to the side; NaN where it is missing."""
    cells = board.cells[start] + side * STEPS[1 - axis]
    a, b = board.at(cells), board.at(cells + STEPS[axis])
    known = ((a >= 0) & (b >= 0))[:, None]
    return np.where(known, points_px[b] - points_px[a], np.nan)


def bridge(board: Board, points_px: Float[np.ndarray, "points 2"]) -> None:
    """Index free points across gaps where local maps agree on an integer cell."""
    member = np.flatnonzero(board.is_member)
    free = np.flatnonzero(~board.is_member)
    if len(member) < _BRIDGE_NEIGHBOURS or not len(free):
        return
    tree = KDTree(points_px[member])
    distance, near = nearest(tree, points_px[free], _BRIDGE_NEIGHBOURS)
    spacing = np.median(nearest(tree, points_px[member], 2)[0][:, 1])
    step = np.minimum(3 * spacing, np.ptp(distance, axis=1) + spacing)
    gap = distance[:, 0] / step
    reachable = gap < _BRIDGE_REACH
    free, near, gap = free[reachable], near[reachable], gap[reachable]
    if not len(free):
        return
    offset = points_px[member[near]] - points_px[free][:, None]
    cells = board.cells[member[near]]
    bent, doubt = _value_at_origin(offset, cells, quadratic=True)
    flat, _ = _value_at_origin(offset[:, :12], cells[:, :12], quadratic=False)
    cell = np.rint(bent).astype(int)
    sure = (np.abs(bent - cell).max(1) < _BRIDGE_OFF) & (doubt < _BRIDGE_DOUBT)
    sure &= (np.abs(flat - bent) < _BRIDGE_BEND).all(1)
    sure &= board.at(cell) < 0
    if (sure & (gap < _BRIDGE_NEAR)).any():  # far ones wait until near ones are in
        sure &= gap < _BRIDGE_NEAR
    _, first = np.unique(cell[sure], axis=0, return_index=True)
    board.place(free[sure][first], cell[sure][first])


def _value_at_origin(offset_px, cells, *, quadratic: bool):
    """Least-squares polynomial of the cells about each point, at that point.

    Also its standard deviation, from the residuals and the extrapolation's leverage.
    """
    scale = np.abs(offset_px).max((1, 2), keepdims=True)
    x, y = np.moveaxis(offset_px / scale, -1, 0)
    columns = [np.ones_like(x), x, y]
    if quadratic:
        columns += [x * x, x * y, y * y]
    design = np.stack(columns, -1)
    normal = np.einsum("nkc,nkd->ncd", design, design)
    inverse = np.linalg.inv(normal + np.diag([0.0] + [1e-6] * (len(columns) - 1)))
    right = np.einsum("nkc,nkd->ncd", design, cells.astype(float))
    fitted = inverse @ right
    residual = cells - design @ fitted
    spare = residual.shape[1] - len(columns)
    variance = (residual**2).sum(1).max(1) / spare + _LEAST_SPREAD**2
    return fitted[:, 0], np.sqrt(variance * np.maximum(inverse[:, 0, 0], 0))


def nanmedian(values: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Median over the first axis, ignoring NaN, without a loop over points."""
    count = np.isfinite(values).sum(0)
    ordered = np.sort(values, axis=0)  # NaN sort last
    low = np.take_along_axis(ordered, np.maximum((count - 1) // 2, 0)[None], 0)[0]
    high = np.take_along_axis(ordered, (count // 2 * (count > 0))[None], 0)[0]
    return np.where(count > 0, (low + high) / 2, np.nan)


MINIMUM_POINTS = 9
_MAXIMUM_SEEDS = 12
_MAXIMUM_ROUNDS = 6
_SHEARS = (
    np.array([[1, 1], [0, 1]]),
    np.array([[1, -1], [0, 1]]),
    np.array([[1, 0], [1, 1]]),
    np.array([[1, 0], [-1, 1]]),
)


def index_lattice(
    points_px: Float[np.ndarray, "points 2"], *, asymmetric: bool = False
) -> tuple[Int[np.ndarray, "points 2"], Bool[np.ndarray, " points"]]:
    """Lattice indices of points, i to the right and j down as photographed.

    Parameters
    ----------
    points_px : Candidate positions, pixels, y down; false points are allowed.
    asymmetric : The target is an asymmetric circle grid (every other row shifted by
        half a step): indices then count half steps, and i + j is even.

    Returns
    -------
    indices : (i, j) of each point, counted from the smallest; 0 where not valid.
    valid : Whether the point belongs to the lattice; all False if there is none.
    """
    points_px = np.asarray(points_px, float)
    indices = np.zeros((len(points_px), 2), int)
    valid = np.zeros(len(points_px), bool)
    board = _largest_component(points_px)
    if board is not None:
        board = board.on_basis(_squarest(board, points_px))
        board.keep_only(consistent_members(board, points_px))
        board = board.on_basis(_upright(board, points_px, asymmetric))
        valid = board.is_member
        least = board.cells[valid].min(0, initial=1 << 30)
        if asymmetric:
            least -= [0, least.sum() % 2]  # keep i + j even
        indices[valid] = board.cells[valid] - least
    return indices, valid


def _largest_component(points_px: np.ndarray) -> Board | None:
    """The board that explains most points, among those grown from a few seeds."""
    if len(points_px) < MINIMUM_POINTS:
        return None
    tree = KDTree(points_px)
    hood = neighbourhoods(points_px, tree)
    untried = hood.regular.copy()
    best, best_count = None, MINIMUM_POINTS - 1
    for _ in range(_MAXIMUM_SEEDS):
        if np.count_nonzero(untried) <= best_count // 2:
            break
        seed = int(np.argmin(np.where(untried, hood.roughness, np.inf)))
        board = _component(points_px, tree, seed, hood.cross[seed])
        untried &= ~board.is_member
        untried[seed] = False
        count = np.count_nonzero(board.is_member)
        if count > best_count:
            best, best_count = board, count
    return best


def _component(points_px, tree: KDTree, seed: int, cross) -> Board:
    """Grow from one seed; then check, bridge gaps and grow again until it rests."""
    board = Board(len(points_px))
    board.place(np.array([seed]), np.array([[0, 0]]))
    board.place(cross, np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]))
    count = 0
    for _ in range(_MAXIMUM_ROUNDS):
        grow(board, points_px, tree)
        board.keep_only(consistent_members(board, points_px))
        grown = np.count_nonzero(board.is_member)
        if grown < MINIMUM_POINTS or grown <= count:
            break
        count = grown
        bridge(board, points_px)
    board.keep_only(consistent_members(board, points_px))
    return board


def _upright(board: Board, points_px, asymmetric: bool) -> Int[np.ndarray, "2 2"]:
    """Matrix from cells to lattice indices, i to the right and j down."""
    jacobian = _known_jacobians(board, points_px)
    to_lattice = np.eye(2)
    if asymmetric:  # primitive cell vectors are (1, 1) and (-1, 1) in half steps
        to_lattice = np.array([[1, -1], [1, 1]])
    if np.median(np.linalg.det(jacobian)) < 0:
        to_lattice = to_lattice @ np.diag([1, -1])
    jacobian = jacobian @ np.linalg.inv(to_lattice)
    axes = (jacobian / np.linalg.norm(jacobian, axis=1, keepdims=True)).mean(0)
    quarter = np.array([[0, -1], [1, 0]])
    turns = [np.linalg.matrix_power(quarter, k) for k in range(4)]
    turn = max(turns, key=lambda t: np.trace(axes @ t.T))
    return np.rint(turn @ to_lattice).astype(int)


def _squarest(board: Board, points_px) -> Int[np.ndarray, "2 2"]:
    """Matrix from cells to those of the basis most nearly square on the whole."""
    jacobian = _known_jacobians(board, points_px)

    def cost(basis):
        cell = jacobian @ basis
        area = np.maximum(np.abs(np.linalg.det(cell)), 1e-12)
        return np.median((cell**2).sum((1, 2)) / area)

    basis, best = np.eye(2), cost(np.eye(2))
    for _ in range(8):
        trials = [basis @ shear for shear in _SHEARS]
        costs = [cost(trial) for trial in trials]
        if min(costs) >= best * (1 - 1e-9):
            break
        basis, best = trials[int(np.argmin(costs))], min(costs)
    return np.rint(np.linalg.inv(basis)).astype(int)


def _known_jacobians(board: Board, points_px) -> Float[np.ndarray, "known 2 2"]:
    jacobian = board.jacobians(points_px)
    return jacobian[np.isfinite(jacobian).all((1, 2))]

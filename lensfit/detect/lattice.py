"""Which dot is which: integer lattice indices of points on a bent, partly seen grid.

The points may come from any doubly periodic target (dots, corners, line crossings)
seen under perspective and strong distortion, with points missing and false points
among them. Nothing global is assumed; neighbouring cells only have to be alike. From
the most regular neighbourhood the lattice grows in wave fronts: every free cell beside
the front predicts its point by extrapolating its indexed neighbours, and takes the
nearest point if that is near enough. Points that then disagree with their
surroundings are freed, seams are cut, and gaps are bridged by a local quadratic map.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from lensfit.detect.lattice_check import bridge, consistent_members
from lensfit.detect.lattice_growth import Board, grow, neighbourhoods

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
        board = board.rebased(_squarest(board, points_px))
        board.keep_only(consistent_members(board, points_px))
        board = board.rebased(_upright(board, points_px, asymmetric))
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

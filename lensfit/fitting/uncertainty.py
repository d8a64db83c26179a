"""How well the parameters, and what they predict, are known.

The covariance is the inverse of the normal equations at the solution: those of the
marks, scaled by the chi-squared that was reached, with what was stated and the priors
that hold what the photographs do not see. What it says of chief rays, apart from what
another pose of the camera would undo, is told in `lensfit.optics.position_deviation`.

Marks that were moved from centroids to chief rays share the errors of the wavefront
that moved them: each of its independent errors moves all marks, the solution follows,
and what it does so is added.

What no residual shows is added as well. Smooth errors of the marks, and distortion for
which the model has no term, are taken up by those it has: of thirty traced lenses,
decentred ones among them, maps were `SYSTEMATIC_PX` wrong, three times as much as noise
alone would have it. So much, over the marks, all terms of the largest named model are
taken to be off together, each as far as it moves marks that poses cannot bring back
(`fit.systematic`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from lensfit.fitting.adjust import Adjustment, equations_at
from lensfit.fitting.geometry import NAMED, compiled_distortion_of
from lensfit.fitting.half_equations import explained_by, halves_of, stated_statistics
from lensfit.fitting.parameters import Layout
from lensfit.fitting.priors import loose_prior
from lensfit.fitting.systematic import covariance_of_equations, systematic_covariance
from lensfit.fitting.take import Take
from lensfit.fitting.views import residuals_of
from lensfit.optics import position_deviation as optics

SYSTEMATIC_PX = 0.006
"""Root mean square over the marks of how far they are moved, apart from what a pose
undoes. Of thirty random traced lenses the median error along either axis was .005, that
of the deviation stated without it .0016."""
_NEXT_ORDER_OF_WALK = 0.3
"""In focal lengths, half of the walk per fourth power of the sine, which is fitted as
if it were one with the square: .65 focal lengths in a 50 mm f/1.4 and in a retrofocus
lens of 100 degrees."""
_GREEN = 1
_LEAST_MOVE = 1e-3
"""Of the largest: smaller ones are lost beside the noise of any mark."""
_NAMED_TERMS = ("principal_point", "radial", *NAMED)
_LANDING = (
    "focal_length",
    "principal_point",
    "radial",
    "squeeze",
    *NAMED,
    "free_field",
)


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of all parameters.

    Rows of fixed parameters are zero, but for named terms of the lens that were left
    out: what they would take up of errors that no residual shows is stated.
    """

    covariance: Float[np.ndarray, "parameters parameters"]
    layout: Layout

    def deviation(self, block: str) -> Float[np.ndarray, " terms"]:
        """Standard deviations of a named block."""
        where = self.layout.blocks[block]
        return np.sqrt(np.maximum(np.diag(self.covariance)[where], 0.0))


def uncertainty_of(adjustment: Adjustment, takes: tuple[Take, ...]) -> Uncertainty:
    """Covariance at the solution of an adjustment.

    Parameters
    ----------
    takes : That were adjusted, in their order.
    """
    one, other = halves_of(adjustment)
    free = adjustment.prior.free
    precision = adjustment.prior.standard_deviation[free] ** -2.0
    residuals = residuals_of(adjustment.stack)[adjustment.used]
    count = max(int(residuals.sum()) - int(free.sum()), 1)
    scale = (one.sum_of_squares + other.sum_of_squares) / count
    matrix = (one.matrix + other.matrix) / max(scale, 1.0)
    matrix = (matrix + stated_statistics(adjustment).matrix)[np.ix_(free, free)]
    inside = covariance_of_equations(matrix + np.diag(precision))
    covariance = np.zeros((len(free), len(free)))
    moves = shared_moves_of(adjustment, takes)
    shared = _moved_by(moves, adjustment, inside / max(scale, 1.0))
    stated = _moved_by_statements(adjustment, inside)
    covariance[np.ix_(free, free)] = inside + shared.T @ shared + stated.T @ stated
    _count_next_order_of_walk(covariance, adjustment)
    _count_held_walk(covariance, adjustment)
    terms = _rows_of(adjustment.layout, _NAMED_TERMS)
    covariance[np.ix_(terms, terms)] += _systematic(adjustment, terms)
    return Uncertainty(covariance, adjustment.layout)


def _count_next_order_of_walk(
    covariance: Float[np.ndarray, "parameters parameters"], adjustment: Adjustment
) -> None:
    """Add to the variance of the walk what its next order does to it, in place; where
    another state told the walk, that is counted with what both have in common."""
    frame, layout = adjustment.frame, adjustment.layout
    stated = adjustment.statements
    if stated is not None and "pupil_walk_at_other_focus" in stated.quantities:
        return
    tangent = float(
        frame.valid_radius * frame.reference_radius_mm / frame.stated_focal_length_mm
    )
    sine2 = tangent**2 / (1 + tangent**2)
    where = layout.blocks["pupil_walk"]
    free = adjustment.prior.free[where]
    covariance[where, where] += np.diag((_NEXT_ORDER_OF_WALK * sine2 * free) ** 2)


def _count_held_walk(
    covariance: Float[np.ndarray, "parameters parameters"], adjustment: Adjustment
) -> None:
    """A walk that the fit held where it was known is as sure as it was then, in place;
    at the chart it moves nothing, so that no other parameter goes with it."""
    where, stated = adjustment.layout.blocks["pupil_walk"], adjustment.statements
    if stated is None or adjustment.prior.free[where].any():
        return
    known_mm = stated.facts.perspective.walk.standard_deviation_mm
    unit_mm = float(adjustment.frame.stated_focal_length_mm)
    covariance[where, where] = (known_mm / unit_mm) ** 2


def _moved_by_statements(
    adjustment: Adjustment, inverse: Float[np.ndarray, "free free"]
) -> Float[np.ndarray, "statements free"]:
    """How the solution follows when what all states of a lens were told moves by one
    standard deviation."""
    if adjustment.statements is None:
        return np.zeros((0, len(inverse)))
    return adjustment.statements.common_pulls[:, adjustment.prior.free] @ inverse


def _systematic(
    adjustment: Adjustment, terms: Int[np.ndarray, " terms"]
) -> Float[np.ndarray, "terms terms"]:
    """Covariance of named terms that together move the marks by `SYSTEMATIC_PX`."""
    layout, views = adjustment.layout, len(adjustment.stack.board)
    poses = layout.local_indices("pose", views).ravel()
    both = np.concatenate([terms, poses])
    nothing = np.zeros(0, int)
    loose = loose_prior(adjustment.parameters, layout, nothing, both)
    one, other = halves_of(replace(adjustment, prior=loose))
    precision = np.diag(np.where(loose.free, loose.standard_deviation, 1.0) ** -2.0)
    matrix = one.matrix + other.matrix
    of_terms, of_poses = np.ix_(terms, terms), np.ix_(poses, poses)
    mixed = matrix[np.ix_(poses, terms)]
    followed = np.linalg.solve(matrix[of_poses] + precision[of_poses], mixed)
    seen = matrix[of_terms] - mixed.T @ followed
    return systematic_covariance(
        (seen + seen.T) / 2,
        np.diag(precision)[terms],
        explained_by(SYSTEMATIC_PX, adjustment),
    )


def shared_moves_of(
    adjustment: Adjustment, takes: tuple[Take, ...]
) -> Float[np.ndarray, "moves views marks 2"]:
    """How the marks move together by what placed them; none where they are as seen."""
    known = [t.shared_moves_mm for t in takes if t.shared_moves_mm is not None]
    most = max((len(moves) for moves in known), default=0)
    moved = np.zeros((most, *adjustment.stack.observed_mm.shape))
    for k, take in enumerate(takes):
        if take.shared_moves_mm is not None:
            count, _, marks, _ = take.shared_moves_mm.shape
            moved[:count, k, :marks] = take.shared_moves_mm[:, _GREEN]
    return moved


def _moved_by(
    moves: Float[np.ndarray, "moves views marks 2"],
    adjustment: Adjustment,
    inverse: Float[np.ndarray, "free free"],
) -> Float[np.ndarray, "moves free"]:
    """How the solution follows when marks move, to first order."""
    free = adjustment.prior.free

    def gradient(moved_mm: np.ndarray | float) -> np.ndarray:
        stack = adjustment.stack
        stack = replace(stack, observed_mm=stack.observed_mm + moved_mm)
        found = equations_at(replace(adjustment, stack=stack)).gradient
        return np.asarray(found).sum(0)[free]

    still = gradient(0.0)
    pulls = [gradient(moved) - still for moved in _principal(moves)]
    return -np.array(pulls).reshape(len(pulls), len(inverse)) @ inverse


def _principal(
    moves: Float[np.ndarray, "moves views marks 2"],
) -> Float[np.ndarray, "fewer views marks 2"]:
    """Fewer moves of the same covariance: most parameters drag all marks alike, and
    every move costs a pass over them."""
    flat = moves.reshape(len(moves), math.prod(moves.shape[1:]))
    _, size, direction = np.linalg.svd(flat, full_matrices=False)
    worth = size > _LEAST_MOVE * np.max(size, initial=0.0)
    principal = size[worth, None] * direction[worth]
    return principal.reshape(len(principal), *moves.shape[1:])


def position_deviation_mm(
    adjustment: Adjustment,
    uncertainty: Uncertainty,
    undistorted_mm: Float[np.ndarray, "points 2"],
) -> Float[np.ndarray, " points"]:
    """Standard deviation of the distorted position (root of both axes' variances).

    `undistorted_mm` should cover the frame: it is over these points that the moves a
    pose would undo are taken out.
    """
    each = position_deviations_mm(adjustment, uncertainty, undistorted_mm)
    return np.hypot(*each.T)


def position_deviations_mm(
    adjustment: Adjustment,
    uncertainty: Uncertainty,
    undistorted_mm: Float[np.ndarray, "points 2"],
) -> Float[np.ndarray, "points 2"]:
    """`position_deviation_mm` along x and along y."""
    layout = adjustment.layout
    shared = jnp.asarray(adjustment.parameters[: layout.shared])
    rows = landing_rows(layout)
    return optics.position_deviations_mm(
        undistorted_mm,
        compiled_distortion_of(shared, layout, adjustment.frame),
        uncertainty.covariance[np.ix_(rows, rows)],
        undistorted_mm,
    )


def landing_rows(layout: Layout) -> Int[np.ndarray, " numbers"]:
    """Where the numbers that `optics.position_deviation.moved` moves lie among the
    parameters, in its order and its units."""
    return _rows_of(layout, _LANDING)


def _rows_of(layout: Layout, names: Sequence[str]) -> Int[np.ndarray, " numbers"]:
    blocks = [layout.blocks[name] for name in names]
    return np.concatenate([np.arange(b.start, b.stop) for b in blocks])

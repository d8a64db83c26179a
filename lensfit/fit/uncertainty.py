"""How well the parameters, and what they predict, are known.

The covariance is the inverse of the normal equations at the solution, scaled by the
chi-squared that was reached, with the priors that hold what the photographs do not
see. What it says of chief rays, apart from what another pose of the camera would undo,
is told in `lensfit.optics.position_deviation`.

Marks that were moved from centroids to chief rays share the errors of the wavefront
that moved them: each of its independent errors moves all marks, the solution follows,
and what it does so is added.

It covers noise and what is not known of the blur, not a wrong model of distortion: for
that there is the held-out error.
"""

import math
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from lensfit.fit.adjust import Adjustment, equations_at
from lensfit.fit.evidence import halves_of
from lensfit.fit.geometry import NAMED, compiled_distortion_of
from lensfit.fit.parameters import Layout
from lensfit.fit.take import Take
from lensfit.fit.views import residuals_of
from lensfit.optics import position_deviation as optics

_GREEN = 1
_LEAST_MOVE = 1e-3
"""Of the largest: smaller ones are lost beside the noise of any mark."""
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
    """Covariance of all parameters; zero rows for the fixed ones."""

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
    matrix = (one.matrix + other.matrix)[np.ix_(free, free)] + np.diag(precision)
    residuals = residuals_of(adjustment.stack)[adjustment.used]
    count = max(int(residuals.sum()) - int(free.sum()), 1)
    scale = (one.sum_of_squares + other.sum_of_squares) / count
    inside = np.linalg.inv(matrix)
    covariance = np.zeros((len(free), len(free)))
    shared = _moved_by(shared_moves_of(adjustment, takes), adjustment, inside)
    covariance[np.ix_(free, free)] = inside * max(scale, 1.0) + shared.T @ shared
    return Uncertainty(covariance, adjustment.layout)


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
    blocks = [layout.blocks[name] for name in _LANDING]
    return np.concatenate([np.arange(b.start, b.stop) for b in blocks])

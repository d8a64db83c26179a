"""How well the parameters, and what they predict, are known.

The covariance is the inverse of the normal equations at the solution, scaled by the
chi-squared that was reached, with the priors that hold what the photographs do not
see. A prediction moves with the parameters; the part of the move that a different pose
of the camera would undo (a homography of the undistorted picture) is no error of the
lens and is taken out before the variance is stated.

Marks that were moved from centroids to chief rays share the errors of the wavefront
that moved them: each of its independent errors moves all marks, the solution follows,
and what it does so is added.

It covers noise and what is not known of the blur, not a wrong model of distortion: for
that there is the held-out error.

Reference: the argument follows mrcal's documentation of projection uncertainty.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.batches import in_batches
from lensfit.fit.adjust import Adjustment, equations_at
from lensfit.fit.evidence import halves_of
from lensfit.fit.geometry import Frame, distortion_of
from lensfit.fit.parameters import Layout
from lensfit.fit.take import Take
from lensfit.fit.views import residuals_of
from lensfit.optics.distortion import distorted_from_undistorted

_BATCH = 1024
_GREEN = 1
_LEAST_MOVE = 1e-3
"""Of the largest: smaller ones are lost beside the noise of any mark."""


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

    def sensitivity(points: np.ndarray) -> Array:
        return _sensitivity(shared, jnp.asarray(points), layout, adjustment.frame)

    by_all = in_batches(sensitivity, undistorted_mm, _BATCH)
    pose = pose_moves(by_all[..., :2], undistorted_mm)
    by_parameter = by_all[..., 2:].reshape(-1, layout.shared)
    undone, *_ = np.linalg.lstsq(pose, by_parameter, rcond=1e-10)
    left = by_parameter - pose @ undone
    part = uncertainty.covariance[: layout.shared, : layout.shared]
    variance = np.einsum("ra,ab,rb->r", left, part, left)
    return np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 2)


def pose_moves(
    by_place: Float[np.ndarray, "points 2 2"],
    undistorted_mm: Float[np.ndarray, "points 2"],
) -> Float[np.ndarray, "coordinates 8"]:
    """How the distorted points (x and y in turn) move as the camera's pose changes.

    Parameters
    ----------
    by_place : d distorted / d undistorted.
    """
    moves = _homography_moves(undistorted_mm)
    return np.einsum("pij,pjk->pik", by_place, moves).reshape(-1, 8)


def _homography_moves(points: np.ndarray) -> np.ndarray:
    """Displacements of a plane's points under the eight small homographies."""
    scale = np.abs(points).max()
    x, y = (points / scale).T
    one, zero = np.ones_like(x), np.zeros_like(x)
    in_x = [one, zero, x, y, zero, zero, x * x, x * y]
    in_y = [zero, one, zero, zero, x, y, x * y, y * y]
    return np.stack([np.stack(in_x, -1), np.stack(in_y, -1)], 1)


@partial(jax.jit, static_argnames=("layout",))
def _sensitivity(
    shared: Array, points: Array, layout: Layout, frame: Frame
) -> Float[Array, "points 2 place_and_parameters"]:
    """Derivative of distorted positions by the place (2 columns), then parameters."""

    def at(point, shared):
        return distorted_from_undistorted(point, distortion_of(shared, layout, frame))

    # In reverse: a position has two components, a lens two hundred parameters.
    both = jax.vmap(jax.jacrev(at, (0, 1)), (0, None))(points, shared)
    return jnp.concatenate(both, -1)

"""The solve of the geometric fit: whitened residuals of all detections, and priors.

The method is that of `levenberg`, with the normal equations of `normal`.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from lensfit.fitting.geometry import BoardPose, Frame
from lensfit.fitting.levenberg import Prior, Quadratic, minimise
from lensfit.fitting.normal import Equations, equations
from lensfit.fitting.parameters import Layout
from lensfit.fitting.view_stack import Detections
from lensfit.programs import kept_program


class Stated(NamedTuple):
    """Statements (`lensfit.fitting.statements`) as p.matrix.p - 2 vector.p +
    constant."""

    matrix: Float[Array, "parameters parameters"]
    vector: Float[Array, " parameters"]
    constant: Float[Array, ""]


class Problem(NamedTuple):
    """Everything the residual needs besides the parameters."""

    views: BoardPose
    detections: Detections
    frame: Frame
    prior_mean: Float[Array, " parameters"]
    prior_precision: Float[Array, " parameters"]
    free: Float[Array, " parameters"]
    stated: Stated

    @property
    def prior(self) -> Prior:
        """As `levenberg` wants it."""
        return Prior(self.prior_mean, self.prior_precision, self.free)


class Solution(NamedTuple):
    """Where the solve ended.

    Attributes
    ----------
    parameters : The solution; fixed ones at their prior mean.
    converged : False when the step limit came first.
    steps : Passes over the detections.
    equations : Of both halves of the detections at the last pass, without priors, and
        of all parameters, also of those that were fixed.
    """

    parameters: Float[Array, " parameters"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    equations: Equations


@kept_program(static_argnames=("layout",))
def solve(
    start: Float[Array, " parameters"],
    problem: Problem,
    layout: Layout,
    tolerance: float,
    most_steps: int,
    first_damping: float,
) -> Solution:
    """Minimise the whitened residuals from `start`; compiled once per layout.

    See `levenberg.minimise` for the last three. None has a default: leaving one out
    would be another program to JAX.
    """
    found = minimise(
        lambda parameters: both_halves(parameters, problem, layout),
        start,
        problem.prior,
        tolerance,
        most_steps,
        first_damping,
    )
    return Solution(found.parameters, found.converged, found.steps, found.extra)


def both_halves(
    parameters: Float[Array, " parameters"], problem: Problem, layout: Layout
) -> tuple[Quadratic, Equations]:
    """The sum of squares of all detections and statements, and the equations of each
    half of the detections."""
    detections, frame = problem.detections, problem.frame
    found = equations(parameters, problem.views, detections, layout, frame)
    return with_statements(total(found), parameters, problem.stated), found


def total(found: Equations) -> Quadratic:
    """Both halves together."""
    return Quadratic(*(jnp.sum(part, 0) for part in found))


def with_statements(
    found: Quadratic, parameters: Float[Array, " parameters"], stated: Stated
) -> Quadratic:
    """The sum of squares, and that of what is stated."""
    turned = stated.matrix @ parameters
    squares = parameters @ (turned - 2 * stated.vector) + stated.constant
    return Quadratic(
        found.matrix + stated.matrix,
        found.gradient + turned - stated.vector,
        found.chi_squared + squares,
    )

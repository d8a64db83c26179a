"""The nonlinear least-squares solve: the only module that calls Optimistix.

Levenberg-Marquardt, as Optimistix composes it (Gauss-Newton, trust region). It is not
shown the residuals of all marks but a vector no longer than the parameters that has
the same normal equations: with A = L L^T, g and chi-squared at hand,

    c = (L^-1 g, sqrt(chi-squared - |L^-1 g|^2)),   dc/dp = (L^T, 0)

has c.c = chi-squared, (dc/dp)^T c = g and (dc/dp)^T (dc/dp) = A. So every step costs
one pass over the marks (`normal`), and the pass is compiled once. The square of the
first part of c is the fall of chi-squared still to be had: it says when to stop.

Marquardt's scaling damps every parameter in proportion to how well the photographs see
it; a prior of zero width removes a parameter from the step.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Bool, Float, Int

from lensfit.fit.chunks import Marks
from lensfit.fit.geometry import Frame, View
from lensfit.fit.normal import Equations, equations
from lensfit.fit.parameters import Layout

_LEAST_DAMPING = 1e-12


class Problem(NamedTuple):
    """Everything the residual needs besides the parameters."""

    views: View
    marks: Marks
    frame: Frame
    prior_mean: Float[Array, " parameters"]
    prior_precision: Float[Array, " parameters"]
    free: Float[Array, " parameters"]


class Solution(NamedTuple):
    """Where the solve ended.

    Attributes
    ----------
    parameters : The solution; fixed ones at their prior mean.
    converged : False when the step limit came first.
    steps : Passes over the marks.
    equations : Of both halves of the marks at the last pass, without priors, and of
        all parameters, also of those that were fixed.
    """

    parameters: Float[Array, " parameters"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    equations: Equations


class _State(NamedTuple):
    """At the last accepted step; `fall` is what it took off chi-squared."""

    matrix: Array
    gradient: Array
    chi_squared: Array
    fall: Array


class MarquardtDescent(
    optx.AbstractDescent[Array, optx.FunctionInfo.ResidualJac, _State]
):
    """-(A + damping diag A)^-1 g, with A and g from the short residual."""

    first_damping: Array | float

    def init(self, y: Array, f_info_struct: Any) -> _State:
        del f_info_struct
        far = jnp.asarray(jnp.inf, y.dtype)
        return _State(jnp.zeros((y.size, y.size), y.dtype), jnp.zeros_like(y), far, far)

    def query(self, y: Array, f_info: Any, state: _State) -> _State:
        del y
        jacobian = f_info.jac.as_matrix()
        chi_squared = jnp.sum(f_info.residual**2)
        return _State(
            jacobian.T @ jacobian,
            f_info.residual @ jacobian,
            chi_squared,
            state.chi_squared - chi_squared,
        )

    def step(self, step_size: Array, state: _State) -> tuple[Array, optx.RESULTS]:
        diagonal = jnp.diagonal(state.matrix) * (self.first_damping / step_size)
        factor = jnp.linalg.cholesky(state.matrix + jnp.diag(diagonal))
        return -cho_solve((factor, True), state.gradient), optx.RESULTS.successful


class LevenbergMarquardt(optx.AbstractGaussNewton[Array, Array, Equations]):
    """Optimistix's Gauss-Newton loop and trust region around the descent above.

    Besides Optimistix's own test it ends when the fall of chi-squared that is still to
    be had, or what the last step took off, is below the share `tolerance` of it:
    further steps would only chase directions the photographs do not see.
    """

    rtol: float
    atol: float
    norm: Callable[[Any], Array]
    descent: MarquardtDescent
    search: optx.ClassicalTrustRegion[Array]
    verbose: Callable[..., None]
    tolerance: Array | float
    most_steps: Array | int

    def __init__(
        self,
        tolerance: Array | float,
        most_steps: Array | int,
        first_damping: Array | float,
    ):
        self.rtol = 1e-10
        self.atol = 1e-10
        self.tolerance = tolerance
        self.most_steps = most_steps
        self.norm = optx.max_norm
        self.descent = MarquardtDescent(first_damping)
        self.search = optx.ClassicalTrustRegion(
            high_cutoff=0.75, high_constant=4.0, low_constant=0.1
        )
        self.verbose = lambda **_: None

    def terminate(
        self, fn: Any, y: Array, args: Any, options: Any, state: Any, tags: Any
    ) -> tuple[Array, optx.RESULTS]:
        """Whether to stop, and how it went."""
        done, result = super().terminate(fn, y, args, options, state, tags)
        late = state.num_steps >= self.most_steps
        slow = (
            state.descent_state.fall < self.tolerance * state.descent_state.chi_squared
        )
        little = _little_left(state, self.tolerance)
        return done | (state.num_steps > 0) & (little | slow) | late, result


def _little_left(state: Any, tolerance: Array | float) -> Bool[Array, ""]:
    """Whether a full Newton step would hardly lower chi-squared."""
    squares = state.f_info.residual**2
    return jnp.sum(squares[:-1]) < tolerance * jnp.sum(squares)


@partial(jax.jit, static_argnames=("layout",))
def solve(
    start: Float[Array, " parameters"],
    problem: Problem,
    layout: Layout,
    tolerance: float,
    most_steps: int,
    first_damping: float,
) -> Solution:
    """Minimise the whitened residuals from `start`; compiled once per layout.

    Parameters
    ----------
    tolerance : Share of chi-squared that is not worth another step.
    most_steps : Passes over the marks; one only evaluates the equations at `start`.
    first_damping : Of the first step. Where the photographs leave a long, curved valley
        an undamped step overshoots, and each such step costs a pass.

    None has a default: leaving one out would be another program to JAX.
    """
    found = optx.least_squares(
        lambda y, args: short_residual(y, args, layout),
        LevenbergMarquardt(tolerance, most_steps, first_damping),
        start,
        has_aux=True,
        args=problem,
        max_steps=None,
        throw=False,
    )
    steps = found.stats["num_steps"]
    converged = (found.result == optx.RESULTS.successful) & (steps < most_steps)
    # The Newton step that was too small to be worth a pass is still worth taking.
    descent = MarquardtDescent(_LEAST_DAMPING)
    last, _ = descent.step(jnp.asarray(1.0), found.state.descent_state)
    near = converged & _little_left(found.state, tolerance)
    value = jnp.where(near, found.value + last, found.value)
    return Solution(_effective(value, problem), converged, steps, found.aux)


def short_residual(
    parameters: Float[Array, " parameters"], problem: Problem, layout: Layout
) -> tuple[Float[Array, " one_more"], Equations]:
    """The vector c of the module docstring, and the equations behind it."""
    fixed_point = jax.lax.stop_gradient(parameters)
    effective = _effective(fixed_point, problem)
    found = equations(effective, problem.views, problem.marks, layout, problem.frame)
    matrix, gradient, chi_squared = with_prior(found, effective, problem)
    scale = jnp.sqrt(jnp.diagonal(matrix))
    damping = jnp.eye(scale.size) * _LEAST_DAMPING
    factor = jnp.linalg.cholesky(matrix / jnp.outer(scale, scale) + damping)
    head = solve_triangular(factor, gradient / scale, lower=True)
    tail = jnp.sqrt(jnp.maximum(chi_squared - jnp.sum(head**2), 0.0))
    head = head + factor.T @ (scale * (parameters - fixed_point))
    return jnp.append(head, tail), found


def with_prior(
    found: Equations, effective: Float[Array, " parameters"], problem: Problem
) -> tuple[
    Float[Array, "parameters parameters"], Float[Array, " parameters"], Float[Array, ""]
]:
    """A, g and chi-squared of all marks and priors; identity rows for fixed ones."""
    free, precision = problem.free, problem.prior_precision
    off = effective - problem.prior_mean
    matrix = jnp.sum(found.matrix, 0) + jnp.diag(precision)
    gradient = jnp.sum(found.gradient, 0) + precision * off
    matrix = matrix * free[:, None] * free[None] + jnp.diag(1 - free)
    chi_squared = jnp.sum(found.chi_squared) + jnp.sum(precision * off**2)
    return matrix, gradient * free, chi_squared


def _effective(parameters: Array, problem: Problem) -> Array:
    """Fixed parameters sit at their prior mean whatever the vector says."""
    return jnp.where(problem.free > 0, parameters, problem.prior_mean)

"""Levenberg-Marquardt on normal equations, as Optimistix composes it.

Optimistix (Gauss-Newton, trust region) is not given the residuals of all detections but
a short vector, one longer than the parameters, that has the same normal equations. With
A = L L^T, g and chi-squared known,

    c = (L^-1 g, sqrt(chi-squared - |L^-1 g|^2)),   dc/dp = (L^T, 0)

has c.c = chi-squared, (dc/dp)^T c = g and (dc/dp)^T (dc/dp) = A. Every step therefore
costs one pass over the data, and the pass is compiled once. The square of the first
part of c is the decrease of chi-squared that a whole Newton step promises.

Marquardt's scaling damps every parameter in proportion to its curvature; a prior of
zero width removes a parameter from the step.

This is the only module that uses Optimistix; `adjust` and `wavefront.stages` define the
problems.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Bool, Float, Int

_LEAST_DAMPING = 1e-12


class Prior(NamedTuple):
    """Gaussian prior of every parameter; `free` is 0 where a parameter is fixed."""

    mean: Float[Array, " parameters"]
    precision: Float[Array, " parameters"]
    free: Float[Array, " parameters"]


class Quadratic(NamedTuple):
    """Sum of squares around a point: half its Hessian, half its gradient, itself."""

    matrix: Float[Array, "parameters parameters"]
    gradient: Float[Array, " parameters"]
    chi_squared: Float[Array, ""]


class Minimum(NamedTuple):
    """Where a minimisation ended.

    Attributes
    ----------
    parameters : The solution; fixed ones at their prior mean.
    converged : False when the step limit came first.
    steps : Passes over the data.
    extra : What the last pass returned besides its equations.
    """

    parameters: Float[Array, " parameters"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    extra: Any


class _State(NamedTuple):
    """At the last accepted step.

    Attributes
    ----------
    fall : What it took off chi-squared.
    near : Whether a whole Newton step from here promises next to nothing.
    whole : Whether such a step led here.
    """

    matrix: Array
    gradient: Array
    chi_squared: Array
    fall: Array
    near: Array
    whole: Array


class MarquardtDescent(
    optx.AbstractDescent[Array, optx.FunctionInfo.ResidualJac, _State]
):
    """-(A + damping diag A)^-1 g, with A and g from the short residual; undamped once
    that promises less than the share `tolerance` of chi-squared."""

    first_damping: Array | float
    tolerance: Array | float

    def init(self, y: Array, f_info_struct: Any) -> _State:
        del f_info_struct
        far, no = jnp.asarray(jnp.inf, y.dtype), jnp.asarray(False)
        matrix = jnp.zeros((y.size, y.size), y.dtype)
        return _State(matrix, jnp.zeros_like(y), far, far, no, no)

    def query(self, y: Array, f_info: Any, state: _State) -> _State:
        del y
        jacobian, squares = f_info.jac.as_matrix(), f_info.residual**2
        chi_squared = jnp.sum(squares)
        return _State(
            matrix=jacobian.T @ jacobian,
            gradient=f_info.residual @ jacobian,
            chi_squared=chi_squared,
            fall=state.chi_squared - chi_squared,
            near=jnp.sum(squares[:-1]) < self.tolerance * chi_squared,
            whole=state.near,
        )

    def step(self, step_size: Array, state: _State) -> tuple[Array, optx.RESULTS]:
        damping = jnp.where(state.near, _LEAST_DAMPING, self.first_damping / step_size)
        diagonal = jnp.diagonal(state.matrix) * damping
        factor = jnp.linalg.cholesky(state.matrix + jnp.diag(diagonal))
        return -cho_solve((factor, True), state.gradient), optx.RESULTS.successful


class LevenbergMarquardt(optx.AbstractGaussNewton[Array, Array, Any]):
    """Optimistix's Gauss-Newton loop and trust region around the descent above.

    Besides Optimistix's own test it ends when what the last step took off chi-squared
    is below the share `tolerance` of it: further steps would only chase directions the
    photographs do not see. So it ends too when a step was rejected, and the next one
    promises as little. The last step is a whole Newton step, along long, flat minima
    too; but it is tried as any other: there it has raised a chi-squared sixfold.
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
        self.descent = MarquardtDescent(first_damping, tolerance)
        self.search = optx.ClassicalTrustRegion(
            high_cutoff=0.75, high_constant=4.0, low_constant=0.1
        )
        self.verbose = lambda **_: None

    def terminate(
        self, fn: Any, y: Array, args: Any, options: Any, state: Any, tags: Any
    ) -> tuple[Array, optx.RESULTS]:
        """Whether to stop, and how it went."""
        done, result = super().terminate(fn, y, args, options, state, tags)
        here = state.descent_state
        rejected = state.num_steps_since_acceptance > 0
        change = jnp.where(rejected, self._predicted_decrease(state), here.fall)
        untried = here.near & ~here.whole & ~rejected
        little = (change < self.tolerance * here.chi_squared) & ~untried
        ended = (state.num_steps > 0) & little
        late = state.num_steps >= self.most_steps
        return done | ended | late, result

    def _predicted_decrease(self, state: Any) -> Array:
        """By how much the next step should lower chi-squared."""
        here = state.descent_state
        step, _ = self.descent.step(state.search_state.step_size, here)
        return -(2 * here.gradient @ step + step @ here.matrix @ step)


def minimise(
    equations: Callable[[Array], tuple[Quadratic, Any]],
    start: Float[Array, " parameters"],
    prior: Prior,
    tolerance: Array | float,
    most_steps: Array | int,
    first_damping: Array | float,
) -> Minimum:
    """Minimise the sum of squares and priors from `start`; for use under `jax.jit`.

    Parameters
    ----------
    equations : From all parameters to the sum of squares without priors, and anything
        else worth keeping.
    tolerance : Share of chi-squared that is not worth another step.
    most_steps : Passes over the data; one only evaluates the equations at `start`.
    first_damping : Of the first step. Where the data leave a long, curved minimum an
        undamped step overshoots, and each such step costs a pass.
    """
    found = optx.least_squares(
        lambda y, _: short_residual(y, equations, prior),
        LevenbergMarquardt(tolerance, most_steps, first_damping),
        start,
        has_aux=True,
        max_steps=None,
        throw=False,
    )
    steps = found.stats["num_steps"]
    converged = (found.result == optx.RESULTS.successful) & (steps < most_steps)
    return Minimum(_effective(found.value, prior), converged, steps, found.aux)


def short_residual(
    parameters: Float[Array, " parameters"],
    equations: Callable[[Array], tuple[Quadratic, Any]],
    prior: Prior,
) -> tuple[Float[Array, " one_more"], Any]:
    """The vector c of the module docstring, and what else the pass returned."""
    fixed_point = jax.lax.stop_gradient(parameters)
    effective = _effective(fixed_point, prior)
    found, extra = equations(effective)
    matrix, gradient, chi_squared = with_prior(found, effective, prior)
    scale = jnp.sqrt(jnp.diagonal(matrix))
    damping = jnp.eye(scale.size) * _LEAST_DAMPING
    factor = jnp.linalg.cholesky(matrix / jnp.outer(scale, scale) + damping)
    head = solve_triangular(factor, gradient / scale, lower=True)
    tail = jnp.sqrt(jnp.maximum(chi_squared - jnp.sum(head**2), 0.0))
    head = head + factor.T @ (scale * (parameters - fixed_point))
    return jnp.append(head, tail), extra


def with_prior(
    found: Quadratic, effective: Float[Array, " parameters"], prior: Prior
) -> Quadratic:
    """The sum of squares and the priors'; identity rows for fixed parameters."""
    free, off = prior.free, effective - prior.mean
    matrix = found.matrix + jnp.diag(prior.precision)
    return Quadratic(
        matrix * free[:, None] * free[None] + jnp.diag(1 - free),
        (found.gradient + prior.precision * off) * free,
        found.chi_squared + jnp.sum(prior.precision * off**2),
    )


def _effective(parameters: Array, prior: Prior) -> Array:
    """Fixed parameters sit at their prior mean whatever the vector says."""
    return jnp.where(prior.free > 0, parameters, prior.mean)

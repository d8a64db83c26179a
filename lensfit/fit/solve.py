"""The nonlinear least-squares solve: the only module that calls Optimistix.

Levenberg-Marquardt, as Optimistix composes it (Gauss-Newton, trust region), with one
part of our own: a descent that takes the step from normal equations gathered block
by block (`normal`), instead of from the dense Jacobian that a generic solver would
have to build. Marquardt's scaling damps every parameter in proportion to how well the
photographs see it; a prior of zero width removes a parameter from the step.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Bool, Float, Int

from lensfit.fit import normal
from lensfit.fit.geometry import Frame, View
from lensfit.fit.parameters import Layout

_FIRST_DAMPING = 1e-7
_LEAST_DAMPING = 1e-12


class Problem(NamedTuple):
    """Everything the residual needs besides the parameters."""

    views: View
    frame: Frame
    prior_mean: Float[Array, " parameters"]
    prior_precision: Float[Array, " parameters"]
    free: Float[Array, " parameters"]


class Solution(NamedTuple):
    """Where the solve ended.

    `converged` is False when the step limit came first.
    """

    parameters: Float[Array, " parameters"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]


class _State(eqx.Module):
    matrix: Array
    gradient: Array
    decrement: Array


class NormalEquationsDescent(
    optx.AbstractDescent[Array, optx.FunctionInfo.ResidualJac, _State]
):
    """-(A + damping diag A)^-1 g with A, g from `equations(parameters)`."""

    equations: Callable[[Array], tuple[Array, Array]]

    def init(self, y: Array, f_info_struct: Any) -> _State:
        del f_info_struct
        matrix, gradient = jax.eval_shape(self.equations, y)
        far = jnp.asarray(jnp.inf, gradient.dtype)
        return _State(_zeros(matrix), _zeros(gradient), far)

    def query(self, y: Array, f_info: Any, state: _State) -> _State:
        del f_info, state
        matrix, gradient = self.equations(y)
        newton = _solve_damped(matrix, gradient, _LEAST_DAMPING)
        return _State(matrix, gradient, gradient @ newton)

    def step(self, step_size: Array, state: _State) -> tuple[Array, optx.RESULTS]:
        damping = _FIRST_DAMPING / step_size
        step = -_solve_damped(state.matrix, state.gradient, damping)
        return step, optx.RESULTS.successful


class NormalEquationsLevenbergMarquardt(optx.AbstractGaussNewton[Array, Array, None]):
    """Optimistix's Gauss-Newton loop and trust region around the descent above.

    Besides Optimistix's own test it ends when the Newton decrement g^T A^-1 g, the
    fall of chi-squared that is still to be had, is below the share `tolerance` of
    chi-squared: further steps would only chase directions the photographs do not see.
    """

    rtol: float
    atol: float
    norm: Callable[[Any], Array]
    descent: NormalEquationsDescent
    search: optx.ClassicalTrustRegion[Array]
    verbose: Callable[..., None]
    tolerance: Array | float
    most_steps: Array | int

    def __init__(
        self,
        tolerance: Array | float,
        most_steps: Array | int,
        descent: NormalEquationsDescent,
    ):
        self.rtol = 1e-10
        self.atol = 1e-10
        self.tolerance = tolerance
        self.most_steps = most_steps
        self.norm = optx.max_norm
        self.descent = descent
        self.search = optx.ClassicalTrustRegion(
            high_cutoff=0.75, high_constant=4.0, low_constant=0.1
        )
        self.verbose = lambda **_: None

    def terminate(
        self, fn: Any, y: Array, args: Any, options: Any, state: Any, tags: Any
    ) -> tuple[Array, optx.RESULTS]:
        """Whether to stop, and how it went."""
        done, result = super().terminate(fn, y, args, options, state, tags)
        chi_squared = jnp.sum(state.f_info.residual**2)
        little = state.descent_state.decrement < self.tolerance * chi_squared
        late = state.num_steps >= self.most_steps
        return done | little | late, result


def residual_vector(parameters: Array, problem: Problem, layout: Layout) -> Array:
    """Whitened residuals of the marks, then of the priors."""
    effective = _effective(parameters, problem)
    marks = normal.residuals(effective, problem.views, layout, problem.frame)
    prior = jnp.sqrt(problem.prior_precision) * (effective - problem.prior_mean)
    return jnp.concatenate([marks.reshape(-1), prior])


def normal_equations(
    parameters: Array, problem: Problem, layout: Layout
) -> tuple[Float[Array, "parameters parameters"], Float[Array, " parameters"]]:
    """J^T J and J^T r with priors; identity rows for parameters that are fixed."""
    effective = _effective(parameters, problem)
    blocks, values = normal.jacobian_blocks(
        effective, problem.views, layout, problem.frame
    )
    matrix, gradient = normal.gather(blocks, values, layout.local)
    free, precision = problem.free, problem.prior_precision
    matrix = matrix + jnp.diag(precision)
    gradient = gradient + precision * (effective - problem.prior_mean)
    matrix = matrix * free[:, None] * free[None]
    return matrix + jnp.diag(1 - free), gradient * free


@partial(jax.jit, static_argnames=("layout",))
def solve(
    start: Float[Array, " parameters"],
    problem: Problem,
    layout: Layout,
    tolerance: float,
    most_steps: int,
) -> Solution:
    """Minimise the whitened residuals from `start`; compiled once per layout.

    `tolerance` is the share of chi-squared that is not worth another step. (Neither it
    nor `most_steps` has a default: leaving one out would be another program to JAX.)
    """
    descent = NormalEquationsDescent(
        eqx.Partial(_equations_of, problem=problem, layout=layout)
    )
    found = optx.least_squares(
        lambda y, args: residual_vector(y, args, layout),
        NormalEquationsLevenbergMarquardt(tolerance, most_steps, descent),
        start,
        args=problem,
        max_steps=None,
        throw=False,
    )
    steps = found.stats["num_steps"]
    converged = (found.result == optx.RESULTS.successful) & (steps < most_steps)
    return Solution(_effective(found.value, problem), converged, steps)


def _equations_of(y: Array, *, problem: Problem, layout: Layout):
    return normal_equations(y, problem, layout)


def _solve_damped(matrix: Array, gradient: Array, damping: Array | float) -> Array:
    """(A + damping diag A)^-1 g: Marquardt's scaling."""
    damped = matrix + jnp.diag(damping * jnp.diagonal(matrix))
    return jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(damped), gradient)


def _zeros(struct: jax.ShapeDtypeStruct) -> Array:
    return jnp.zeros(struct.shape, struct.dtype)


def _effective(parameters: Array, problem: Problem) -> Array:
    """Fixed parameters sit at their prior mean whatever the vector says."""
    return jnp.where(problem.free > 0, parameters, problem.prior_mean)

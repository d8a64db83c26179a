"""The solve of the wavefront fit (`fitting.levenberg`): dots, statements and priors."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from lensfit.fitting.levenberg import Prior, Quadratic, minimise
from lensfit.fitting.wavefront.normal import (
    Equations,
    Model,
    PerDot,
    Points,
    normal_equations,
)
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.stated import Statements, stated_equations
from lensfit.programs import kept_program


class Solution(NamedTuple):
    """Where the solve ended.

    Attributes
    ----------
    parameters : The solution; fixed ones at their prior mean.
    converged : False when the step limit came first.
    steps : Passes over the patches.
    equations, per_dot : At the last pass.
    """

    parameters: Float[Array, " parameters"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    equations: Equations
    per_dot: PerDot


@kept_program(static_argnames=("layout", "points"))
def solve(
    start: Float[Array, " parameters"],
    model: Model,
    prior: Prior,
    statements: Statements,
    layout: Layout,
    points: Points,
    tolerance: float,
    most_steps: int,
    first_damping: float,
) -> Solution:
    """Minimise from `start`; one program per layout and number of points.

    See `levenberg.minimise`; a single step only evaluates.
    """

    def equations(parameters: Array) -> tuple[Quadratic, tuple[Equations, PerDot]]:
        found, per_dot = normal_equations(parameters, model, layout, points)
        of_dots = Quadratic(*(jnp.sum(part, 0) for part in found))
        of_stated = stated_equations(parameters, statements, layout)
        return jax.tree.map(jnp.add, of_dots, of_stated), (found, per_dot)

    found = minimise(equations, start, prior, tolerance, most_steps, first_damping)
    return Solution(found.parameters, found.converged, found.steps, *found.extra)

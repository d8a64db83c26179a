"""Gathered normal equations against the dense Jacobian of a small, complete case."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lensfit.fit import solve
from lensfit.fit.geometry import Frame, View
from lensfit.fit.parameters import Layout

LAYOUT = Layout(radial=2, free_degree=3, bend_degree=2, stretch_degree=2, apertures=1)
VIEWS, MARKS = 3, 10


@pytest.fixture(scope="module")
def problem() -> solve.Problem:
    rng = np.random.default_rng(0)
    size = LAYOUT.size(VIEWS)
    turns = Rotation.from_rotvec(rng.normal(0, 0.2, (VIEWS, 3))).as_matrix()
    views = View(
        rotation=jnp.asarray(turns),
        translation_mm=jnp.asarray(rng.normal([0, 0, 900], 20.0, (VIEWS, 3))),
        aperture=jnp.asarray([0, 1, 0]),
        half_board_mm=jnp.full((VIEWS, 2), 250.0),
        whole_board=jnp.asarray([1.0, 0.0, 1.0]),
        board=jnp.asarray(rng.uniform(-1, 1, (VIEWS, MARKS, 2))),
        observed_mm=jnp.asarray(rng.normal(0, 4, (VIEWS, MARKS, 2))),
        whitening=jnp.asarray(rng.normal(0, 30, (VIEWS, MARKS, 2, 2))),
    )
    frame = Frame(
        jnp.asarray(30.0),
        jnp.asarray(15.0),
        jnp.zeros(2),
        jnp.asarray(1.05),
        jnp.array([[-0.8, -0.6], [0.8, 0.6]]),
    )
    free = np.ones(size)
    free[[3, 9, 40, size - 2]] = 0.0
    return solve.Problem(
        views=views,
        frame=frame,
        prior_mean=jnp.asarray(rng.normal(0, 0.002, size)),
        prior_precision=jnp.asarray(rng.uniform(1, 50, size) * free),
        free=jnp.asarray(free),
    )


def test_gathered_equations_are_those_of_the_dense_jacobian(problem):
    at = jnp.asarray(np.random.default_rng(1).normal(0, 0.002, LAYOUT.size(VIEWS)))

    def residual(parameters):
        return solve.residual_vector(parameters, problem, LAYOUT)

    jacobian = np.asarray(jax.jit(jax.jacfwd(residual))(at))
    value = np.asarray(residual(at))
    fixed = np.asarray(1 - problem.free)
    matrix, gradient = jax.jit(solve.normal_equations, static_argnums=2)(
        at, problem, LAYOUT
    )
    dense = jacobian.T @ jacobian + np.diag(fixed)
    scale = np.sqrt(np.outer(np.diag(dense), np.diag(dense)))
    np.testing.assert_allclose(matrix / scale, dense / scale, atol=1e-10)
    # The principal point moves the free field's box, whose fold guard is not
    # differentiated along with it; everything else is exact.
    expected = jacobian.T @ value
    np.testing.assert_allclose(gradient, expected, rtol=1e-9, atol=1e-7)

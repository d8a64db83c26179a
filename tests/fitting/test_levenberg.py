"""Levenberg-Marquardt on normal equations: curved minima, fixed parameters and
priors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit.fitting.levenberg import Prior, Quadratic, minimise

WIDE = Prior(jnp.zeros(2), jnp.zeros(2), jnp.ones(2))


def _residual(p):
    """Rosenbrock's function, a constant left over: chi-squared 1 at (1, 1)."""
    return jnp.stack([1 - p[0], 10 * (p[1] - p[0] ** 2), jnp.ones_like(p[0])])


def _equations(p):
    r, jacobian = _residual(p), jax.jacfwd(_residual)(p)
    return Quadratic(jacobian.T @ jacobian, jacobian.T @ r, r @ r), r


@jax.jit
def _minimise(start, prior, tolerance, most_steps):
    return minimise(_equations, start, prior, tolerance, most_steps, 1e-3)


@pytest.mark.parametrize("start", [(-1.2, 1.0), (2.0, -3.0)])
def test_the_end_of_a_curved_valley_is_found(start):
    found = _minimise(jnp.array(start), WIDE, 1e-10, 80)
    assert bool(found.converged)
    np.testing.assert_allclose(found.parameters, [1.0, 1.0], atol=1e-4)
    assert 3 < int(found.steps) < 80


def test_too_few_steps_say_so():
    found = _minimise(jnp.array([-1.2, 1.0]), WIDE, 1e-10, 3)
    assert not bool(found.converged)
    assert int(found.steps) == 3


def test_a_single_step_only_evaluates():
    start = jnp.array([-1.2, 1.0])
    found = _minimise(start, WIDE, 1e-10, 1)
    np.testing.assert_array_equal(found.parameters, start)
    np.testing.assert_allclose(found.extra, _residual(start))


def test_a_fixed_parameter_stays_at_its_mean():
    prior = Prior(jnp.array([0.5, 0.0]), jnp.zeros(2), jnp.array([0.0, 1.0]))
    found = _minimise(jnp.array([-1.2, 1.0]), prior, 1e-10, 80)
    assert float(found.parameters[0]) == 0.5
    np.testing.assert_allclose(found.parameters[1], 0.25, atol=1e-6)


def test_a_prior_pulls_by_its_precision():
    """With x fixed at 1, 100 (y - 1)^2 + w (y - 3)^2 is least at a weighted mean."""
    for precision in (1.0, 100.0):
        prior = Prior(
            jnp.array([1.0, 3.0]), jnp.array([0.0, precision]), jnp.array([0.0, 1.0])
        )
        found = _minimise(jnp.array([0.0, 0.0]), prior, 1e-10, 80)
        mean = (100 + precision * 3) / (100 + precision)
        np.testing.assert_allclose(found.parameters, [1.0, mean], atol=1e-6)


def _hidden_wall(p):
    """Almost flat from (1, 0) to where a wall begins, which nothing here shows: a full
    Newton step leads far into it."""
    wall = jnp.maximum(0.9 - p[0], 0.0) ** 2
    return jnp.stack([jnp.full_like(p[0], 10.0), 0.01 * p[0] + 5.0 * wall, p[1]])


def test_no_step_is_taken_untried():
    """What promises a millionth of chi-squared may raise it by a sixth."""

    def equations(p):
        r, jacobian = _hidden_wall(p), jax.jacfwd(_hidden_wall)(p)
        return Quadratic(jacobian.T @ jacobian, jacobian.T @ r, r @ r), r

    start = jnp.array([1.0, 0.0])
    found = jax.jit(lambda s: minimise(equations, s, WIDE, 1e-4, 30, 1e-3))(start)
    assert bool(found.converged)
    end = _hidden_wall(found.parameters)
    assert float(end @ end) <= float(_hidden_wall(start) @ _hidden_wall(start))
    np.testing.assert_allclose(found.extra, end)

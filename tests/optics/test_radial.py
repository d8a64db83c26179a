"""The radial profile: it cannot fold, its first order is Brown's, it inverts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from lensfit.optics.distortion import log_slope, magnification, undistorted_radius

VALID = jnp.asarray(1.1**2)
RADII = jnp.linspace(0.0, 3.0, 601)


@jax.jit
def _profile(radius, coefficients):
    return radius * jax.vmap(lambda r: magnification(r**2, coefficients, VALID))(radius)


@jax.jit
def _inverse(radius, coefficients):
    return jax.vmap(lambda r: undistorted_radius(r, coefficients, VALID))(radius)


def _wild(seed: int, size: float) -> jnp.ndarray:
    return jnp.asarray(np.random.default_rng(seed).normal(0, size, 4))


def test_no_coefficients_leave_every_radius_alone():
    one = magnification(jnp.asarray(0.7), jnp.zeros(0), VALID)
    assert abs(float(one) - 1) < 1e-14


@pytest.mark.parametrize("k1", [1e-4, -1e-4])
def test_first_coefficient_is_three_times_browns_k1(k1):
    radius = jnp.linspace(0.1, 1.0, 10)
    mine = _profile(radius, jnp.asarray([3 * k1, 0.0, 0.0, 0.0]))
    brown = radius * (1 + k1 * radius**2)
    np.testing.assert_allclose(mine, brown, atol=20 * k1**2)


def test_profile_is_the_integral_of_its_slope():
    coefficients = jnp.asarray([0.5, -0.4, 0.2, -0.05])
    polynomial = np.polynomial.Polynomial([0, 0.5, -0.4, 0.2, -0.05])
    for radius in (0.3, 0.8, 1.1):
        exact = quad(lambda r: np.exp(polynomial(r * r)), 0, radius, epsabs=1e-14)[0]
        mine = _profile(jnp.asarray([radius]), coefficients)[0]
        assert abs(float(mine) - exact) < 1e-12


@pytest.mark.parametrize(("size", "furthest"), [(0.2, 3.0), (0.5, 1.15)])
def test_profile_increases_for_any_strong_coefficients(size, furthest):
    """Size 0.5 changes the scale at the edge of the frame threefold."""
    radii = VALID**0.5 * jnp.linspace(0.0, furthest, 601)
    for seed in range(60):
        steps = np.diff(_profile(radii, _wild(seed, size)))
        assert (steps > 0).all(), seed


def test_a_brown_polynomial_that_folds_has_no_folding_counterpart():
    folding = np.diff(np.asarray(RADII) * (1 - 0.5 * np.asarray(RADII) ** 2))
    assert (folding < 0).any()
    mine = np.diff(_profile(RADII, jnp.asarray([-1.5, 0.0, 0.0, 0.0])))
    assert (mine > 0).all()


def test_slope_stops_following_the_polynomial_beyond_the_frame():
    coefficients = jnp.asarray([2.0, 1.0, 1.0, 1.0])
    ceiling = log_slope(1.35 * VALID, coefficients, jnp.asarray(1e9))
    far = log_slope(jnp.asarray([3.0, 100.0, 1e8]) * VALID, coefficients, VALID)
    assert (np.asarray(far) <= float(ceiling)).all()
    np.testing.assert_allclose(far[1:], ceiling)


def test_profile_is_a_straight_line_far_beyond_the_frame():
    profile = np.asarray(_profile(jnp.linspace(1.5, 9.0, 31), _wild(3, 0.2)))
    np.testing.assert_allclose(np.diff(profile, 2), 0, atol=1e-12)


def test_slope_has_no_kink_at_the_edge_of_the_frame():
    def slope(s):
        return log_slope(s, _wild(3, 0.5), VALID)

    first, second = jax.jit(jax.grad(slope)), jax.jit(jax.grad(jax.grad(slope)))
    for derivative in (first, second):
        below, above = derivative(VALID * (1 - 1e-7)), derivative(VALID * (1 + 1e-7))
        np.testing.assert_allclose(below, above, rtol=1e-4)


@jax.jit
def _magnified(packed):
    """By square of the radius and coefficients in one array."""
    return magnification(packed[0], packed[1:], VALID)


_gradient = jax.jit(jax.grad(_magnified))


@pytest.mark.parametrize("s", [0.0, 0.4, 1.5, 4.0])
def test_derivative_equals_the_finite_difference(s):
    at = jnp.concatenate([jnp.asarray([s]), _wild(5, 0.4)])
    h = 1e-6
    analytic = _gradient(at)
    difference = [
        (_magnified(at + h * e) - _magnified(at - h * e)) / (2 * h) for e in np.eye(5)
    ]
    np.testing.assert_allclose(analytic, difference, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("size", [0.1, 0.2])
def test_inverse_pair_to_rounding_also_far_outside(size):
    for seed in range(20):
        coefficients = _wild(seed, size)
        back = _inverse(_profile(RADII, coefficients), coefficients)
        np.testing.assert_allclose(back, RADII, atol=1e-12, rtol=1e-12)


def test_inverse_of_zero_is_zero():
    assert float(_inverse(jnp.zeros(1), _wild(1, 1.0))[0]) < 1e-290

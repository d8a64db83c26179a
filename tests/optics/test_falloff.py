"""Relative illumination: bounded, never rising outwards, 1 on the axis."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BPoly

from lensfit.optics.bernstein import bernstein
from lensfit.optics.falloff import log_loss

S = jnp.linspace(0.0, 3.0, 301)


def _illumination(control, s=S):
    control = jnp.asarray(control)
    return np.exp(-np.asarray(jax.vmap(lambda v: log_loss(v, control))(s)))


@pytest.mark.parametrize("terms", [1, 2, 5])
def test_within_zero_and_one_and_never_rising_outwards(terms):
    for seed in range(10):
        rises = np.random.default_rng(seed).exponential(0.3, terms)
        light = _illumination(np.cumsum(rises))
        assert light[0] == 1.0
        assert (light > 0).all()
        assert (np.diff(light) <= 1e-15).all()


def test_no_loss_is_one_everywhere():
    np.testing.assert_array_equal(_illumination(np.zeros(3)), 1.0)


def test_inside_it_is_scipys_bernstein_polynomial():
    control = np.array([0.1, 0.15, 0.6, 0.9])
    inside = np.linspace(0, 1, 21)
    reference = BPoly(np.concatenate([[0.0], control])[:, None], [0, 1])(inside)
    light = _illumination(control, jnp.asarray(inside))
    np.testing.assert_allclose(-np.log(light), reference, atol=1e-14)


def test_equal_rises_are_a_straight_logarithm():
    """Bernstein polynomials reproduce straight lines: -ln I = b s, also outside."""
    light = _illumination(0.25 * np.arange(1, 5) / 4)
    np.testing.assert_allclose(-np.log(light), 0.25 * np.asarray(S), atol=1e-13)


def test_cos4_is_represented_to_a_thousandth():
    """Natural vignetting of a 25 mm lens on a 15 mm image radius."""
    s = np.linspace(0, 1, 50)
    cos4 = (1 + s * (15 / 25) ** 2) ** -2
    basis = bernstein(s, 4)
    control = np.linalg.lstsq(basis, -np.log(cos4))[0]
    assert (np.diff(control, prepend=0) > 0).all()
    light = _illumination(control, jnp.asarray(s))
    np.testing.assert_allclose(light, cos4, atol=1e-3)


def test_continuation_has_neither_step_nor_kink():
    control = jnp.array([0.05, 0.2, 0.7])
    slope = jax.grad(lambda s: log_loss(s, control))
    np.testing.assert_allclose(slope(jnp.asarray(1 - 1e-9)), 3 * 0.5, rtol=1e-6)
    np.testing.assert_allclose(slope(jnp.asarray(1 + 1e-9)), 3 * 0.5, rtol=1e-6)
    assert np.isfinite(slope(jnp.asarray(0.0)))

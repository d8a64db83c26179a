"""Pupil modes: orthogonal gradients of unit size, a chief ray that stays put."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pupil_modes import modes_up_to

from lensfit.optics.terms import (
    Mode,
    power_series,
    powers_in,
    wavefront,
    wavefront_slopes,
)

HIGHEST = 8
MODES = modes_up_to(HIGHEST)


def disc_rule(rings: int = 12, azimuths: int = 40):
    """Points and weights that integrate polynomials over the unit disc exactly."""
    nodes, weights = np.polynomial.legendre.leggauss(rings)
    radius = np.sqrt((nodes + 1) / 2)
    angle = 2 * np.pi * np.arange(azimuths) / azimuths
    points = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    share = np.repeat(weights / 2 / azimuths, azimuths)
    return jnp.asarray(points.reshape(-1, 2)), jnp.asarray(share)


def gradient(u, series):
    return wavefront_slopes(u, series)[0]


_height = jax.jit(wavefront)
_slopes = jax.jit(wavefront_slopes, static_argnums=2)


@jax.jit
def _derivatives(u, series):
    """First and second ones, by JAX."""
    return jax.grad(wavefront)(u, series), jax.hessian(wavefront)(u, series)


@partial(jax.jit, static_argnums=1)
def _gradients_of(points, modes):
    unit = jnp.eye(2 * len(modes)).reshape(-1, len(modes), 2)
    series = jax.vmap(lambda amplitude: power_series(amplitude, modes))(unit)
    return jax.vmap(jax.vmap(gradient, (None, 0)), (0, None))(points, series)


def gradients(modes: tuple[Mode, ...]):
    """(points, modes, parts, 2) gradients at the points of `disc_rule`."""
    points, share = disc_rule()
    found = _gradients_of(points, modes)
    return found.reshape(len(points), len(modes), 2, 2), share


def test_gradients_are_orthogonal_and_of_unit_size():
    """Except among m = 1, whose linear part was taken out."""
    modes = tuple(mode for mode in MODES if mode.order != 1)
    values, share = gradients(modes)
    flat = values.reshape(len(share), -1, 2)
    gram = np.asarray(jnp.einsum("k,kic,kjc->ij", share, flat, flat))
    present = np.ones((len(modes), 2), bool)
    present[[m.order == 0 for m in modes], 1] = False
    np.testing.assert_allclose(
        gram, np.diag(present.reshape(-1).astype(float)), atol=1e-12
    )


def test_the_chief_ray_stays_where_it_is():
    series = power_series(jnp.ones((len(MODES), 2)), MODES)
    np.testing.assert_allclose(gradient(jnp.zeros(2), series), 0, atol=1e-14)


@pytest.mark.parametrize("degree", [3, 5, 7])
def test_coma_of_any_degree_has_no_linear_part(degree: int):
    mode = (Mode(degree, 1),)
    series = power_series(jnp.ones((1, 2)), mode)
    slope = jax.jit(jax.jacfwd(gradient))(jnp.zeros(2), series)
    np.testing.assert_allclose(slope, 0, atol=1e-14)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.3, -0.2), (-0.6, 0.8), (1.1, 0.7)])
def test_slopes_are_the_derivatives_of_the_wavefront(place):
    """Of all powers, and of those that occur."""
    rng = np.random.default_rng(5)
    series = power_series(jnp.asarray(rng.normal(size=(len(MODES), 2))), MODES)
    u = jnp.array(place)
    wanted = _derivatives(u, series)
    for powers in (None, powers_in(MODES)):
        for one, other in zip(_slopes(u, series, powers), wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-11, atol=1e-11)


def test_a_turned_pupil_turns_the_modes():
    turn = 0.7
    x = jnp.array([0.3, -0.6])
    rotation = jnp.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for mode in MODES:
        amplitude = jnp.array([[0.4, -1.1]])
        m = mode.order
        cos, sin = np.cos(m * turn), np.sin(m * turn)
        turned = jnp.array([[cos, -sin], [sin, cos]]) @ amplitude[0]
        here = _height(x, power_series(amplitude, (mode,)))
        there = _height(rotation @ x, power_series(turned[None], (mode,)))
        np.testing.assert_allclose(here, there, atol=1e-13)

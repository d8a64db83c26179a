"""Lateral colour: the formula, its inverse, and its limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit.optics.lateral import (
    MAX_GRADIENT,
    ChannelShift,
    channel_from_green,
    green_from_channel,
)

AXIS = np.array([0.3, -0.2])
CENTRE = jnp.asarray(AXIS)
REFERENCE = jnp.asarray(15.0)
X = np.linspace(-21.0, 21.0, 15)
GRID = jnp.asarray(np.stack(np.meshgrid(X, X), -1).reshape(-1, 2))


def _over(function, points, shift):
    return jax.vmap(lambda p: function(p, shift, CENTRE, REFERENCE))(points)


@jax.jit
def _forward(points, shift):
    return _over(channel_from_green, points, shift)


@jax.jit
def _back(points, shift):
    return _over(green_from_channel, points, shift)


@jax.jit
def _slopes(points, shift):
    return _over(jax.jacfwd(channel_from_green), points, shift)


def _shift(radial, shift_mm=(0.0, 0.0), valid=1.05, **lopsided) -> ChannelShift:
    lopsided = {name: jnp.asarray(value) for name, value in lopsided.items()}
    return ChannelShift(
        jnp.asarray(radial), jnp.asarray(shift_mm), jnp.asarray(valid), **lopsided
    )


LOPSIDED = {"strain": (1e-3, -2e-3), "decentering": (-4e-4, 7e-4)}


def test_inside_the_frame_it_is_the_stated_polynomial():
    c0, c1, c2 = 1e-3, -6e-4, 2e-4
    q = np.array([[0.0, 0.0], [0.2, 0.1], [-0.5, 0.4], [0.6, -0.7]])
    green = q * 15.0 + AXIS
    moved = np.asarray(_forward(green, _shift([c0, c1, c2], (0.002, -0.001)))) - green
    r2 = np.sum(q**2, -1, keepdims=True)
    expected = 15.0 * q * (c0 + c1 * r2 + c2 * r2**2) + [0.002, -0.001]
    np.testing.assert_allclose(moved, expected, atol=1e-14)


def test_pure_magnification_scales_about_the_principal_point():
    green = np.array([[5.0, 3.0], [-8.0, 2.0]])
    moved = np.asarray(_forward(green, _shift([0.002]))) - AXIS
    np.testing.assert_allclose(moved, 1.002 * (green - AXIS), rtol=1e-14)


def test_decentering_is_the_first_order_of_a_moved_axis():
    """c1 q |q|^2 about a near axis: a shift, strain, change of scale and decentering.

    The axis is so near that its square does not matter.
    """
    c1, axis = 0.01, np.array([3e-5, -2e-5])
    q = np.array([[0.2, 0.1], [-0.5, 0.4], [0.6, -0.7]])
    about = q - axis
    true = c1 * about * np.sum(about**2, -1, keepdims=True)
    brown = (-c1 * axis[1], -c1 * axis[0])
    shift = _shift([0.0, c1], decentering=brown)
    moved = np.asarray(_forward(q * 15.0 + AXIS, shift)) - (q * 15.0 + AXIS)
    np.testing.assert_allclose(moved, 15.0 * true, atol=15 * 1e-10)


def test_strain_stretches_one_azimuth_and_shrinks_the_one_across():
    azimuth, size = 0.4, 2e-3
    strain = (size * np.cos(2 * azimuth), size * np.sin(2 * azimuth))
    along = np.array([np.cos(azimuth), np.sin(azimuth)])
    across = np.array([-along[1], along[0]])
    points = 5.0 * np.stack([along, across]) + AXIS
    moved = np.asarray(_forward(points, _shift([0.0], strain=strain))) - points
    np.testing.assert_allclose(moved, 5.0 * size * np.stack([along, -across]), 1e-12)


def test_lopsided_colour_inverts_and_stays_beyond_the_photographed_radius():
    shift = _shift([1e-3, -2e-3], (0.01, -0.02), **LOPSIDED)
    np.testing.assert_allclose(_back(_forward(GRID, shift), shift), GRID, atol=1e-12)
    ray = np.array([0.6, 0.8])
    radii = np.array([1.05, 1.2, 2.0]) * 15.0
    points = radii[:, None] * ray + AXIS
    moved = np.asarray(_forward(points, shift)) - points
    np.testing.assert_allclose(moved, moved[:1] * np.ones((3, 1)), atol=1e-13)


@pytest.mark.parametrize("radial", [[1e-3, -2e-3, 1e-3], [0.05, -0.08, 0.04]])
def test_inverse_pair_over_frame_and_overscan(radial):
    shift = _shift(radial, (0.01, -0.02))
    np.testing.assert_allclose(_back(_forward(GRID, shift), shift), GRID, atol=1e-12)
    np.testing.assert_allclose(_forward(_back(GRID, shift), shift), GRID, atol=1e-12)


def test_displacement_beyond_the_photographed_radius_stays_what_it_was():
    shift = _shift([1e-3, 2e-3])
    direction = np.array([0.6, 0.8])
    radii = np.array([1.05, 1.3, 5.0])[:, None] * 15.0
    green = radii * direction + AXIS
    moved = np.asarray(_forward(green, shift) - green)
    np.testing.assert_allclose(moved, np.broadcast_to(moved[0], moved.shape), rtol=1e-9)


@pytest.mark.parametrize("size", [1.0, 1e6])
def test_no_coefficients_make_it_fold(size):
    for seed in range(5):
        shift = _shift(np.random.default_rng(seed).normal(0, size, 3))
        gradient = np.asarray(_slopes(GRID, shift)) - np.eye(2)
        assert (
            np.linalg.norm(gradient, ord=2, axis=(-2, -1)).max() < MAX_GRADIENT + 1e-9
        )
        np.testing.assert_allclose(
            _back(_forward(GRID, shift), shift), GRID, atol=1e-11
        )


def test_derivative_on_the_axis_is_the_magnification():
    shift = _shift([2e-3, 1e-3])

    def at(p):
        return channel_from_green(p, shift, CENTRE, REFERENCE)

    for derivative in (jax.jacfwd, jax.jacrev):
        found = jax.jit(derivative(at))(CENTRE)
        np.testing.assert_allclose(found, 1.002 * np.eye(2), atol=1e-14)

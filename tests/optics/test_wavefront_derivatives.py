"""What the wavefront fit takes from the optics: gradients, amplitudes and moments."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pupil_modes import modes_up_to

from lensfit.optics.pupil import clear_pupil, opening_area
from lensfit.optics.pupil_nodes import polar_nodes, pupil_nodes
from lensfit.optics.terms import (
    decentring_terms,
    mode_amplitudes,
    mode_gradients,
    modes_of,
    power_series,
    rotational_terms,
    term_amplitudes,
    two_mirror_terms,
    wavefront_slopes,
)

ONE = jnp.asarray(1.0)
MODES = modes_up_to(6)
TERMS = rotational_terms(5) + decentring_terms() + two_mirror_terms(3)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.3, -0.2), (-0.6, 0.8), (0.9, 0.7)])
def test_every_mode_has_the_gradient_of_its_wavefront(place):
    """Each alone, its Re and its Im member, beyond the unit disc too."""
    u = jnp.array(place)
    found = mode_gradients(u, MODES)

    @jax.jit
    def alone(amplitudes):
        return wavefront_slopes(u, power_series(amplitudes, MODES))[0]

    units = jnp.eye(2 * len(MODES)).reshape(-1, len(MODES), 2)
    wanted = jnp.stack([alone(unit) for unit in units])
    np.testing.assert_allclose(found.reshape(-1, 2), wanted, atol=1e-13)


def test_amplitudes_of_terms_add_up_to_those_of_modes():
    rng = np.random.default_rng(2)
    coefficients = jnp.asarray(rng.normal(0, 1, len(TERMS)))
    for h in rng.uniform(-1, 1, (4, 2)):
        row, pair = term_amplitudes(jnp.asarray(h), TERMS)
        wanted = mode_amplitudes(jnp.asarray(h), coefficients, TERMS)
        total = np.zeros((len(modes_of(TERMS)), 2))
        np.add.at(total, row, np.asarray(pair * coefficients[:, None]))
        np.testing.assert_allclose(total, wanted, atol=1e-13)


@pytest.mark.parametrize("angle", [0.4, 2.9])
def test_a_field_function_is_one_at_the_edge_and_turns_with_the_field(angle):
    """|conj(eta) F| of a term is 1 at the edge of the field, on the axis 0 if k > 0."""
    h = jnp.array([np.cos(angle), np.sin(angle)])
    _, pair = term_amplitudes(h, TERMS)
    np.testing.assert_allclose(np.hypot(*np.asarray(pair).T), 1.0, rtol=1e-12)
    _, on_axis = term_amplitudes(jnp.zeros(2), TERMS)
    turning = np.array([t.field_order != 0 for t in TERMS])
    assert not np.any(np.asarray(on_axis)[turning])
    for term, (re, im) in zip(TERMS, np.asarray(pair), strict=True):
        eta = np.exp(1j * term.field_order * angle)
        wanted = [eta.real, eta.imag] if term.part == "re" else [-eta.imag, eta.real]
        np.testing.assert_allclose([re, im], wanted, atol=1e-12)


def test_polar_nodes_have_the_exact_moments_of_the_disc():
    """<|u|^(2k)> = R^(2k) / (k + 1), and no odd ones."""
    radius = 0.5
    h = jnp.array([0.3, 0.4])
    nodes = polar_nodes(h, jnp.asarray(radius), clear_pupil(), 6, 24)
    u, weight = np.asarray(nodes.u), np.asarray(nodes.weight)
    np.testing.assert_allclose(weight.sum(), 1.0, rtol=1e-12)
    for k in range(1, 6):
        moment = weight @ np.sum(u**2, -1) ** k
        np.testing.assert_allclose(moment, radius ** (2 * k) / (k + 1), rtol=1e-5)
    np.testing.assert_allclose(weight @ u, 0.0, atol=1e-9)
    np.testing.assert_allclose(weight @ (u[:, 0] ** 3 * u[:, 1]), 0.0, atol=1e-9)


def test_polar_nodes_of_a_cats_eye_are_as_many_rays():
    eye = replace(
        clear_pupil(2),
        rim_shift=jnp.array([[0.5, 0.1], [-0.6, 0.05]]),
        rim_radius=jnp.array([[1.05, 0.05], [1.1, -0.05]]),
        stop_shift=jnp.array([0.03, -0.01]),
        stretch=jnp.array([[-0.15, 0.02], [-0.04, 0.01]]),
    )
    h = jnp.array([0.6, 0.7])
    few, many = (
        polar_nodes(h, ONE, eye, 8, 48, 64.0),
        pupil_nodes(h, ONE, eye, 20000, 64.0),
    )
    for moment in (
        lambda u: u,
        lambda u: u[:, :1] * u,
        lambda u: np.sum(u**2, -1, keepdims=True) * u,
    ):
        one, other = (
            np.asarray(n.weight) @ moment(np.asarray(n.u)) for n in (few, many)
        )
        np.testing.assert_allclose(one, other, atol=5e-4)
    np.testing.assert_allclose(few.area, opening_area(h, ONE, eye, 64.0), rtol=1e-12)
    assert np.hypot(*(np.asarray(few.weight) @ np.asarray(few.u))) > 5e-3

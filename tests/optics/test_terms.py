"""Terms over the field: counts, symmetry, and the span of the classical polynomials."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit.optics.terms import (
    Term,
    decentring_terms,
    mode_amplitudes,
    modes_of,
    power_series,
    rotational_terms,
    two_mirror_terms,
    wavefront,
)

RNG = np.random.default_rng(3)


@partial(jax.jit, static_argnames="terms")
def value(h, u, coefficients, terms):
    amplitudes = mode_amplitudes(h, coefficients, terms)
    return wavefront(u, power_series(amplitudes, modes_of(terms)))


@partial(jax.jit, static_argnames="terms")
def _values(h, u, coefficients, terms):
    """Of every ray with every set of coefficients."""
    each = jax.vmap(lambda h, u, c: value(h, u, c, terms), (None, None, 0))
    return jax.vmap(each, (0, 0, None))(h, u, coefficients)


@pytest.mark.parametrize(
    ("order", "count"), [(1, 1), (3, 5), (5, 13), (7, 26), (9, 45)]
)
def test_counts_are_hopkins(order: int, count: int):
    assert len(rotational_terms(order)) == count


def test_growth_only_adds():
    for order in (3, 5, 7):
        assert set(rotational_terms(order)) < set(rotational_terms(order + 2))


@pytest.mark.parametrize("order", [3, 5, 7])
def test_a_centred_lens_is_spanned_by_the_invariants(order: int):
    """Polynomials in h.h, h.u, u.u without constant and tilt, to the same degree."""
    terms = rotational_terms(order)
    h, u = jnp.asarray(RNG.uniform(-0.7, 0.7, (2, 400, 2)))
    unit = jnp.eye(len(terms))
    ours = np.asarray(_values(h, u, unit, terms))
    hh, hu, uu = (np.asarray((a * b).sum(-1)) for a, b in ((h, h), (h, u), (u, u)))
    half = (order + 1) // 2
    theirs = np.stack(
        [
            hh**i * hu**j * uu**k
            for i in range(half + 1)
            for j in range(half + 1 - i)
            for k in range(half + 1 - i - j)
            if j + k and (j, k) != (1, 0)
        ],
        -1,
    )
    assert theirs.shape == ours.shape
    solved, *_ = np.linalg.lstsq(theirs, ours, rcond=None)
    np.testing.assert_allclose(theirs @ solved, ours, atol=1e-8)


def test_mirrors_and_turns():
    turn = 1.1
    rotation = jnp.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    mirror = jnp.array([1.0, -1.0])
    h, u = jnp.array([0.5, -0.2]), jnp.array([-0.3, 0.8])
    centred = rotational_terms(7)
    anamorphic = two_mirror_terms(5)
    c = jnp.asarray(RNG.normal(size=len(centred)))
    a = jnp.asarray(RNG.normal(size=len(anamorphic)))
    here = value(h, u, c, centred)
    np.testing.assert_allclose(value(rotation @ h, rotation @ u, c, centred), here)
    np.testing.assert_allclose(value(mirror * h, mirror * u, c, centred), here)
    here = value(h, u, a, anamorphic)
    for flip in (mirror, -mirror):
        np.testing.assert_allclose(value(flip * h, flip * u, a, anamorphic), here)
    assert abs(value(rotation @ h, rotation @ u, a, anamorphic) - here) > 1e-3


def test_decentring_breaks_every_mirror():
    terms = decentring_terms()
    h, u = jnp.array([0.5, -0.2]), jnp.array([-0.3, 0.8])
    for i in range(len(terms)):
        c = jnp.zeros(len(terms)).at[i].set(1.0)
        assert (
            abs(value(-h, -u, c, terms) - value(h, u, c, terms)) > 1e-3
            or (terms[i].order_u + terms[i].field_order) % 2 == 0
        )


def test_families_name_the_growth():
    assert [t.family for t in rotational_terms(3)] == [
        "defocus 1",
        "field curvature 3",
        "astigmatism 3",
        "coma 3",
        "spherical 3",
    ]
    assert Term(2, 2, 0, 0).family == "asymmetric astigmatism 1"

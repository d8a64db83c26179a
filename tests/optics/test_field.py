"""Small displacements: Brown's formulas, symmetry, and the guard against folding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit.optics import field
from lensfit.optics.field import (
    MAX_GRADIENT,
    displacement,
    fold_guard,
    free_basis,
    free_degrees,
    named_basis,
)

BOX = jnp.array([[-0.8, -0.6], [0.8, 0.6]])
POINTS = np.random.default_rng(0).uniform(-0.7, 0.7, (20, 2))
SHIFTED_BOX = jnp.array([[-0.9, -0.5], [0.7, 0.7]])


_named_bases = jax.jit(jax.vmap(named_basis))
_displacement = jax.jit(displacement, static_argnums=4)
_free_basis = jax.jit(free_basis, static_argnums=2)
_fold_guard = jax.jit(fold_guard, static_argnums=3)


def _named(points):
    return np.asarray(_named_bases(jnp.asarray(points)))


@jax.jit
def _jacobians(points, named, free, box):
    def moved(q):
        return q + displacement(q, named, free, box, 4)

    return jax.vmap(jax.jacfwd(moved))(points)


def test_decentering_is_browns():
    x, y = POINTS.T
    r2 = x**2 + y**2
    p1, p2 = 0.3, -0.7
    brown = np.stack(
        [
            2 * p1 * x * y + p2 * (r2 + 2 * x**2),
            p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
        ],
        -1,
    )
    basis = _named(POINTS)
    np.testing.assert_allclose(p1 * basis[:, 0] + p2 * basis[:, 1], brown, atol=1e-15)
    higher = p1 * basis[:, 2] + p2 * basis[:, 3]
    np.testing.assert_allclose(higher, brown * r2[:, None], atol=1e-15)


def test_thin_prism_moves_along_one_axis_by_even_powers():
    r2 = np.sum(POINTS**2, -1)
    prism = _named(POINTS)[:, 4:8]
    np.testing.assert_allclose(prism[:, 0, 0], r2)
    np.testing.assert_allclose(prism[:, 3, 1], r2**2)
    assert not prism[:, [0, 2], 1].any()
    assert not prism[:, [1, 3], 0].any()


def test_anamorphic_terms_keep_both_mirror_symmetries():
    basis = _named(POINTS)[:, 8:]
    for mirror in ([-1.0, 1.0], [1.0, -1.0]):
        np.testing.assert_allclose(_named(POINTS * mirror)[:, 8:], basis * mirror)


def test_named_terms_are_not_radial_and_not_each_others_sums():
    """With the radial terms they span as many dimensions as they are."""
    r2 = np.sum(POINTS**2, -1)[:, None]
    radial = np.stack([POINTS * r2, POINTS * r2**2], 1)
    columns = np.concatenate([_named(POINTS), radial], 1)
    matrix = np.swapaxes(columns, 0, 1).reshape(columns.shape[1], -1)
    singular = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=1)[:, None])[1]
    assert singular[-1] > 1e-3


def test_free_field_is_chebyshev_products_of_degree_three_and_more():
    degrees = free_degrees(6)
    assert degrees.sum(1).min() == 3
    assert degrees.sum(1).max() == 6
    at = np.array([0.31, -0.22])
    unit = at / np.array([0.8, 0.6])
    expected = np.cos(degrees * np.arccos(unit)).prod(-1)
    np.testing.assert_allclose(
        _free_basis(jnp.asarray(at), BOX, 6), expected, atol=1e-14
    )


def test_free_fields_are_nested_and_none_below_degree_three():
    q = jnp.array([0.2, 0.1])
    small, large = _free_basis(q, BOX, 4), _free_basis(q, BOX, 7)
    np.testing.assert_array_equal(small, large[: len(small)])
    assert free_basis(q, BOX, 0).shape == (0,)


def test_displacement_outside_the_box_is_the_one_at_its_border():
    rng = np.random.default_rng(2)
    named = jnp.asarray(rng.normal(0, 0.003, 16))
    free = jnp.asarray(rng.normal(0, 0.003, (2, len(free_degrees(4)))))
    for out, border in (([2.0, 0.1], [0.8, 0.1]), ([-3.0, 9.0], [-0.8, 0.6])):
        far, near = (
            _displacement(jnp.array(at), named, free, BOX, 4) for at in (out, border)
        )
        np.testing.assert_array_equal(far, near)


def test_guard_leaves_displacements_of_real_lenses_alone():
    """Two hundredths of the reference radius are far more than lenses show."""
    rng = np.random.default_rng(3)
    named = jnp.asarray(rng.uniform(-1, 1, 16) * 1e-3)
    free = jnp.asarray(rng.uniform(-1, 1, (2, len(free_degrees(4)))) * 5e-4)
    assert abs(float(_fold_guard(named, free, BOX, 4)) - 1) < 1e-9


@pytest.mark.parametrize("size", [0.05, 1.0, 1e3, 1e12])
@pytest.mark.parametrize("box", [BOX, SHIFTED_BOX])
def test_no_coefficients_make_the_map_fold(size, box):
    x = np.linspace(-1.3, 1.3, 41)
    points = jnp.asarray(np.stack(np.meshgrid(x, x), -1).reshape(-1, 2))
    for seed in range(6):
        rng = np.random.default_rng(seed)
        named = jnp.asarray(rng.normal(0, size, 16))
        free = jnp.asarray(rng.normal(0, size, (2, len(free_degrees(4)))))
        jacobians = np.asarray(_jacobians(points, named, free, box))
        assert (np.linalg.det(jacobians) > 0).all()
        gradient = np.linalg.norm(jacobians - np.eye(2), ord=2, axis=(-2, -1))
        assert gradient.max() < MAX_GRADIENT * (1 + 1e-9)


@pytest.mark.parametrize("term", range(16))
def test_a_single_huge_named_term_cannot_fold(term):
    """The bound is taken on samples of the border: check it between them."""
    x = np.linspace(-1, 1, 39)
    points = jnp.asarray(np.stack(np.meshgrid(x, x), -1).reshape(-1, 2) * [0.8, 0.6])
    named = jnp.zeros(16).at[term].set(1e6)
    free = jnp.zeros((2, len(free_degrees(4))))
    jacobians = np.asarray(_jacobians(points, named, free, BOX))
    assert (np.linalg.det(jacobians) > 0).all()


def test_derivatives_equal_finite_differences():
    """On the axis, inside the box and outside; in coefficients and box too."""
    rng = np.random.default_rng(4)
    terms = len(free_degrees(4))
    coefficients = np.concatenate([rng.normal(0, 5e-4, 16 + 2 * terms), [0.02, -0.03]])

    @jax.jit
    def d(p):
        box = BOX + p[-2:][None]
        return displacement(p[:2], p[2:18], p[18:-2].reshape(2, -1), box, 4)

    h = 1e-6
    slope = jax.jit(jax.jacfwd(d))
    for q in ([0.0, 0.0], [0.31, -0.27], [1.4, 0.2]):
        at = np.concatenate([q, coefficients])
        step = np.eye(len(at)) * h
        difference = [(d(at + e) - d(at - e)) / (2 * h) for e in step]
        np.testing.assert_allclose(slope(at), np.stack(difference, -1), atol=2e-8)


def test_named_terms_summed_up_and_their_gradients_are_those_of_the_basis():
    rng = np.random.default_rng(6)
    points = jnp.asarray(rng.uniform(-1.2, 1.2, (20, 2)))
    named = jnp.asarray(rng.normal(size=16))

    @jax.jit
    def both(points):
        summed = jax.vmap(lambda q: field._named_displacement(q, named))(points)
        gradients = jax.vmap(jax.jacfwd(named_basis))(points)
        return summed, field._named_gradients(points), gradients

    summed, found, wanted = both(points)
    np.testing.assert_allclose(found, wanted, atol=1e-13)
    expected = np.einsum("t,ptc->pc", named, _named(points))
    np.testing.assert_allclose(summed, expected, atol=1e-13)

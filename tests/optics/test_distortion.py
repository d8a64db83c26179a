"""The chief-ray map: limits, no folds, exact inverse, implicit derivatives, squeeze."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from lens_makers import REFERENCE_MM, frame_points_mm, strong_lens, wild_lens

from lensfit.optics.distortion import (
    Distortion,
    distorted_from_direction,
    distorted_from_undistorted,
    jacobian_at,
    no_distortion,
    undistorted_from_distorted,
)
from lensfit.optics.projection import BASE_PROJECTIONS

FRAME = frame_points_mm()


@eqx.filter_jit
def _distort(points: jnp.ndarray, lens: Distortion) -> jnp.ndarray:
    return jax.vmap(lambda p: distorted_from_undistorted(p, lens))(points)


_land = eqx.filter_jit(distorted_from_direction)


@eqx.filter_jit
def _undistort(points: jnp.ndarray, lens: Distortion) -> jnp.ndarray:
    return jax.vmap(lambda p: undistorted_from_distorted(p, lens))(points)


@eqx.filter_jit
def _jacobians(points: jnp.ndarray, lens: Distortion) -> jnp.ndarray:
    return jax.vmap(lambda p: jacobian_at(p, lens))(points)


def test_ideal_lens_is_a_pinhole():
    lens = no_distortion(50.0, REFERENCE_MM)
    np.testing.assert_allclose(_distort(FRAME, lens), FRAME, atol=1e-13)
    landed = _land(jnp.array([100.0, -40.0, 2000.0]), lens)
    np.testing.assert_allclose(landed, [2.5, -1.0], rtol=1e-14)


@pytest.mark.parametrize("base", BASE_PROJECTIONS)
def test_direction_and_its_pinhole_image_land_at_the_same_place(base):
    lens = strong_lens(1, base)
    direction = jnp.array([700.0, -300.0, 2000.0])
    pinhole = lens.principal_point_mm + lens.principal_distance_mm * jnp.array(
        [0.35, -0.15]
    )
    np.testing.assert_allclose(
        _land(direction, lens),
        _distort(pinhole[None], lens)[0],
        atol=1e-12,
    )


def test_first_order_agrees_with_browns_model():
    """k1 per square mm of the pinhole image is a1 = 3 k1 R^2, to first order."""
    k1_per_mm2, p1_per_mm = 1e-7, 1e-7
    lens = no_distortion(30.0, REFERENCE_MM)
    lens = replace(
        lens,
        radial=jnp.asarray([3 * k1_per_mm2 * REFERENCE_MM**2]),
        named=lens.named.at[0].set(p1_per_mm * REFERENCE_MM),
    )
    inside = frame_points_mm(overscan=0.9)
    x, y = np.asarray(inside).T
    r2 = x**2 + y**2
    brown = np.asarray(inside) * (1 + k1_per_mm2 * r2[:, None])
    brown += p1_per_mm * np.stack([2 * x * y, r2 + 2 * y * y], -1)
    np.testing.assert_allclose(_distort(inside, lens), brown, atol=2e-8)


@pytest.mark.parametrize("base", BASE_PROJECTIONS)
@pytest.mark.parametrize("squeeze", [1.0, 2.0])
def test_inverse_pair_over_frame_and_overscan(base, squeeze):
    for seed in range(4):
        lens = strong_lens(seed, base, squeeze=squeeze)
        undistorted = _undistort(FRAME, lens)
        assert np.abs(undistorted - FRAME).max() > 0.1
        np.testing.assert_allclose(_distort(undistorted, lens), FRAME, atol=2e-12)
        again = _undistort(_distort(FRAME, lens), lens)
        np.testing.assert_allclose(again, FRAME, atol=2e-12, rtol=1e-12)


@pytest.mark.parametrize("size", [0.1, 10.0, 1e8])
def test_wild_coefficients_never_fold_and_still_invert(size):
    wide = frame_points_mm(overscan=1.6, count=17)
    for seed in range(4):
        lens = wild_lens(seed, size)
        assert (np.linalg.det(_jacobians(wide, lens)) > 0).all()
        back = _undistort(_distort(wide, lens), lens)
        np.testing.assert_allclose(back, wide, atol=1e-9)


@pytest.mark.slow
def test_implicit_derivative_in_points_and_parameters():
    lens = strong_lens(2, squeeze=2.0, degree=3)
    data = replace(lens, valid_radius=None, box=None, reference_radius_mm=None)
    values, rebuild = ravel_pytree(eqx.filter(data, eqx.is_array))
    point = jnp.array([7.0, -5.0])

    @jax.jit
    def undistorted(packed):
        changed = rebuild(packed[2:])
        whole = replace(
            changed,
            valid_radius=lens.valid_radius,
            box=lens.box,
            reference_radius_mm=lens.reference_radius_mm,
        )
        return undistorted_from_distorted(packed[:2], whole)

    at = jnp.concatenate([point, values])
    analytic = jax.jacfwd(undistorted)(at)
    h = 1e-5
    steps = jnp.eye(at.size) * h
    difference = jnp.stack(
        [(undistorted(at + e) - undistorted(at - e)) / (2 * h) for e in steps], -1
    )
    np.testing.assert_allclose(analytic, difference, rtol=2e-6, atol=2e-6)
    np.testing.assert_allclose(jax.jacrev(undistorted)(at), analytic, atol=1e-10)


def test_derivatives_are_finite_on_the_axis():
    lens = strong_lens(3, "equidistant", degree=3)
    for function in (distorted_from_undistorted, undistorted_from_distorted):
        slopes = jax.jit(jax.jacrev(function, (0, 1)))
        for leaf in jax.tree.leaves(slopes(lens.principal_point_mm, lens)):
            assert np.isfinite(leaf).all()


def test_jacobian_on_the_axis_of_a_radial_lens_is_the_identity():
    lens = replace(no_distortion(25.0, REFERENCE_MM), radial=jnp.array([0.5, -0.3]))
    on_axis = _jacobians(jnp.zeros((1, 2)), lens)[0]
    np.testing.assert_allclose(on_axis, np.eye(2), atol=1e-13)


@pytest.mark.parametrize("squeeze", [1.33, 2.0, 1 + 1e-7, 1.0])
def test_squeeze_has_the_stated_ratio_along_x_and_keeps_areas(squeeze):
    lens = replace(
        no_distortion(50.0, REFERENCE_MM), squeeze=jnp.array([np.log(squeeze), 0.0])
    )
    jacobian = np.asarray(_jacobians(jnp.array([[2.0, 1.0]]), lens))[0]
    np.testing.assert_allclose(np.linalg.det(jacobian), 1, rtol=1e-13)
    np.testing.assert_allclose(jacobian[1, 1] / jacobian[0, 0], squeeze, rtol=1e-13)
    np.testing.assert_allclose(jacobian[[0, 1], [1, 0]], 0, atol=1e-15)


@pytest.mark.parametrize("azimuth", [0.4, -1.1])
def test_squeezed_axis_lies_at_the_stated_azimuth(azimuth):
    """Along the axis lengths shrink by the root of the squeeze, across they grow."""
    e = np.log(1.8) * np.array([np.cos(2 * azimuth), np.sin(2 * azimuth)])
    lens = replace(no_distortion(50.0, REFERENCE_MM), squeeze=jnp.asarray(e))
    along = np.array([np.cos(azimuth), np.sin(azimuth)])
    across = np.array([-along[1], along[0]])
    jacobian = np.asarray(_jacobians(jnp.zeros((1, 2)), lens))[0]
    np.testing.assert_allclose(jacobian @ along, along / np.sqrt(1.8), rtol=1e-12)
    np.testing.assert_allclose(jacobian @ across, across * np.sqrt(1.8), rtol=1e-12)


def test_radial_lens_commutes_with_rotation_about_its_axis():
    lens = replace(
        no_distortion(25.0, REFERENCE_MM, "equidistant"), radial=jnp.array([0.4, -0.2])
    )
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    turned = _distort(jnp.asarray(np.asarray(FRAME) @ turn), lens)
    np.testing.assert_allclose(
        turned, np.asarray(_distort(FRAME, lens)) @ turn, atol=1e-12
    )


def test_free_field_stays_on_the_sensor_when_the_principal_point_moves():
    lens = replace(
        strong_lens(4), radial=jnp.zeros(0), named=jnp.zeros(16), squeeze=jnp.zeros(2)
    )
    moved = replace(
        lens,
        principal_point_mm=lens.principal_point_mm + 0.5,
        principal_distance_mm=lens.principal_distance_mm,
    )
    np.testing.assert_allclose(
        _distort(FRAME, lens), _distort(FRAME, moved), atol=1e-12
    )


@pytest.mark.parametrize(
    ("base", "limit"), [("stereographic", 2.0), ("equidistant", np.pi / 2)]
)
def test_no_undistorted_point_beyond_90_degrees(base, limit):
    lens = no_distortion(10.0, REFERENCE_MM, base)
    points = jnp.array([[0.99, 0.0], [0.0, 1.01], [2.0, 2.0]]) * limit * 10.0
    undistorted = np.asarray(_undistort(points, lens))
    assert np.isfinite(undistorted[0]).all()
    assert np.isnan(undistorted[1:]).all()

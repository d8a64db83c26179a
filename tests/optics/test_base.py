"""Ideal projections: closed forms, azimuth kept, inverse pairs, the 90 degree limit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit.optics.projection import (
    BASE_PROJECTIONS,
    image_of_direction,
    image_of_undistorted,
    undistorted_of_image,
)

RADIUS = {
    "rectilinear": np.tan,
    "stereographic": lambda theta: 2 * np.tan(theta / 2),
    "equidistant": lambda theta: theta,
}
ANGLES = np.concatenate(
    [[0.0, 1e-9, 1e-7, 1e-6, 1.1e-6, 1e-4], np.linspace(0.01, 1.5, 40)]
)


def _directions(angles: np.ndarray, azimuth: float, length: float) -> jnp.ndarray:
    side = np.sin(angles) * length
    rows = [side * np.cos(azimuth), side * np.sin(azimuth), np.cos(angles) * length]
    return jnp.asarray(np.stack(rows, -1))


@pytest.mark.parametrize("base", BASE_PROJECTIONS)
@pytest.mark.parametrize(("azimuth", "length"), [(0.3, 1.0), (-2.5, 1234.5)])
def test_radius_follows_the_closed_form_and_azimuth_is_kept(base, azimuth, length):
    project = jax.vmap(lambda d: image_of_direction(d, base))
    image = np.asarray(project(_directions(ANGLES, azimuth, length)))
    radius = RADIUS[base](ANGLES)
    expected = radius[:, None] * [np.cos(azimuth), np.sin(azimuth)]
    np.testing.assert_allclose(image, expected, rtol=2e-12, atol=0)


@pytest.mark.parametrize(
    ("base", "radius"), [("stereographic", 2 * np.tan(1.0)), ("equidistant", 2.0)]
)
def test_wide_bases_see_behind_the_pupil(base, radius):
    image = image_of_direction(_directions(np.array(2.0), 0.0, 5.0), base)
    np.testing.assert_allclose(image, [radius, 0], atol=1e-12)


def test_rectilinear_lens_does_not_image_what_is_behind_it():
    behind = image_of_direction(jnp.array([0.1, 0.2, -1.0]), "rectilinear")
    assert np.isnan(behind).all()


@pytest.mark.parametrize("base", BASE_PROJECTIONS)
def test_images_of_the_pinhole_plane_invert(base):
    angles = jnp.asarray(ANGLES)
    plane = jnp.stack([jnp.tan(angles) * 0.6, jnp.tan(angles) * -0.8], -1)
    image = jax.vmap(lambda p: image_of_undistorted(p, base))(plane)
    back = jax.vmap(lambda p: undistorted_of_image(p, base))(image)
    np.testing.assert_allclose(back, plane, rtol=2e-12, atol=1e-20)


@pytest.mark.parametrize(
    ("base", "limit"), [("stereographic", 2.0), ("equidistant", np.pi / 2)]
)
def test_there_is_no_pinhole_image_at_90_degrees_and_beyond(base, limit):
    just_inside = undistorted_of_image(jnp.array([limit * 0.999, 0.0]), base)
    assert np.isfinite(just_inside).all()
    for radius in (limit * 1.0001, limit * 3):
        outside = undistorted_of_image(jnp.array([0.0, radius]), base)
        assert np.isnan(outside).all()


@pytest.mark.parametrize("base", BASE_PROJECTIONS)
def test_all_bases_agree_to_second_order_near_the_axis(base):
    radius = 1e-3
    image = image_of_direction(jnp.array([radius, 0.0, 1.0]), base)
    assert abs(float(image[0]) / radius - 1) < radius**2


@pytest.mark.parametrize("base", BASE_PROJECTIONS)
def test_derivative_on_the_axis_is_the_identity(base):
    for slope in (
        jax.jacfwd(lambda p: image_of_undistorted(p, base)),
        jax.jacrev(lambda p: image_of_undistorted(p, base)),
        jax.jacfwd(lambda p: undistorted_of_image(p, base)),
        jax.jacrev(lambda p: undistorted_of_image(p, base)),
    ):
        at_axis = jax.jit(slope)(jnp.zeros(2))
        np.testing.assert_allclose(at_axis, np.eye(2), atol=1e-12)

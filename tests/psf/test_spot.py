"""Spots: convergence with rays, moments in closed form, colours, symmetry."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from blurred_lens import NO_LATERAL, blurred_lens, moments, perfect, spot_at

FIELD_MM = jnp.array([6.0, 8.0])


def lens_spot(rays: int, *, blur=None, field=FIELD_MM, dz=0.1, lateral=NO_LATERAL):
    return _traced(field, blur or blurred_lens(), jnp.asarray(dz), lateral, rays)


@eqx.filter_jit
def _traced(field, lens, dz, lateral, rays):
    return spot_at(field, lens, dz, rays, lateral=lateral)


def test_a_defocused_perfect_lens_makes_a_disc():
    """On the axis: radius dz tan(asin(1/2N)), the variance of its exact profile."""
    image = lens_spot(900, blur=perfect(blurred_lens()), field=jnp.zeros(2), dz=0.3)
    sine = 0.5 / 1.4
    rim = 0.3 * sine / np.sqrt(1 - sine**2)
    reach = np.hypot(*np.asarray(image.landing_mm).T).max()
    np.testing.assert_allclose(reach, rim, rtol=2e-3)
    # <tan^2> / 2 over an even filling of sin^2 up to sine^2.
    square = sine**2
    variance = 0.3**2 * (-np.log(1 - square) / square - 1) / 2
    found = moments(image).covariance_mm2
    np.testing.assert_allclose(found, variance * np.eye(2), atol=5e-3 * variance)


@pytest.mark.slow
def test_second_moments_converge_at_least_like_one_over_rays():
    reference = moments(lens_spot(30000))
    counts = np.array([48, 96, 192, 384, 768, 1536])
    errors = []
    for count in counts:
        found = moments(lens_spot(int(count)))
        errors.append(
            np.abs(found.covariance_mm2 - reference.covariance_mm2).max()
            / reference.covariance_mm2.max()
        )
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slope < -0.9, (slope, errors)
    assert errors[3] < 0.015, errors


def test_few_rays_have_the_moments_of_many():
    few, many = (moments(lens_spot(count)) for count in (300, 1500))
    size = float(np.trace(many.covariance_mm2))
    assert np.abs(few.covariance_mm2 - many.covariance_mm2).max() < 0.02 * size
    assert np.abs(few.centroid_mm - many.centroid_mm).max() < 0.02 * size**0.5


def test_a_spot_turns_with_the_field():
    """A centred lens: the covariance at a turned field point is the turned one."""
    turn = 0.9
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    here = moments(lens_spot(1500))
    there = moments(lens_spot(1500, field=jnp.asarray(rotation) @ FIELD_MM))
    size = float(np.trace(here.covariance_mm2))
    np.testing.assert_allclose(
        there.covariance_mm2,
        rotation @ np.asarray(here.covariance_mm2) @ rotation.T,
        atol=2e-3 * size,
    )
    np.testing.assert_allclose(
        there.centroid_mm, rotation @ here.centroid_mm, atol=2e-3 * size**0.5
    )


def test_lateral_colour_moves_the_centroid():
    shift = jnp.array([[0.01, -0.02]] * 3)
    still = moments(lens_spot(300)).centroid_mm
    moved = moments(lens_spot(300, lateral=shift)).centroid_mm
    np.testing.assert_allclose(moved - still, [0.01, -0.02], atol=1e-12)

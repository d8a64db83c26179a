"""Spots: convergence with rays, moments in closed form, holes, colours, symmetry."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from blurred_lens import CHROMATIC, NO_LATERAL, ONE, blurred_lens

from lensfit.kernel.spot import Blur, dot_spot, moments, through_hole
from lensfit.optics.pupil import clear_pupil

FIELD_MM = jnp.array([6.0, 8.0])


def lens_spot(rays: int, *, deal: bool = True, blur=None, field=FIELD_MM, dz=0.1):
    lens = blur or blurred_lens()
    shift = jnp.asarray(dz)
    return _traced(field, lens, shift, NO_LATERAL, rays, deal)


@eqx.filter_jit
def _traced(field, lens, dz, lateral, rays, deal):
    image, _ = dot_spot(field, lens, ONE, dz, CHROMATIC, lateral, rays=rays, deal=deal)
    return image


def perfect(blur: Blur) -> Blur:
    zero = replace(
        blur.aberration,
        coefficients_um=jnp.zeros_like(blur.aberration.coefficients_um),
        colour_um=jnp.zeros_like(blur.aberration.colour_um),
    )
    return Blur(zero, clear_pupil())


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


def test_second_moments_converge_at_least_like_one_over_rays():
    reference = moments(lens_spot(30000, deal=False))
    counts = np.array([48, 96, 192, 384, 768, 1536])
    errors = []
    for count in counts:
        found = moments(lens_spot(int(count), deal=False))
        errors.append(
            np.abs(found.covariance_mm2 - reference.covariance_mm2).max()
            / reference.covariance_mm2.max()
        )
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slope < -0.9, (slope, errors)
    assert errors[3] < 0.015, errors


def test_dealing_the_wavelengths_agrees_with_all_for_each():
    dealt = moments(lens_spot(600))
    full = moments(lens_spot(600, deal=False))
    size = np.sqrt(np.trace(full.covariance_mm2))
    np.testing.assert_allclose(dealt.centroid_mm, full.centroid_mm, atol=0.01 * size)
    np.testing.assert_allclose(
        dealt.covariance_mm2, full.covariance_mm2, atol=0.01 * size**2
    )


def test_rays_that_cannot_be_dealt_are_refused():
    with pytest.raises(ValueError, match="multiple"):
        lens_spot(100)


def test_a_hole_adds_its_moments():
    hole = jnp.array([[0.006, 0.001], [0.0, 0.004]])
    image = lens_spot(3000, blur=perfect(blurred_lens()), dz=0.02)
    inside = moments(through_hole(image, hole))
    closed = moments(image, hole)
    np.testing.assert_allclose(inside.centroid_mm, closed.centroid_mm, atol=1e-4)
    np.testing.assert_allclose(
        inside.covariance_mm2, closed.covariance_mm2, atol=0.02 * 0.004**2
    )


def test_a_spot_turns_with_the_field():
    """A centred lens: the covariance at a turned field point is the turned one."""
    turn = 0.9
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    here = moments(lens_spot(1500, deal=False))
    there = moments(lens_spot(1500, deal=False, field=jnp.asarray(rotation) @ FIELD_MM))
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
    blur = blurred_lens()
    still = moments(lens_spot(300)).centroid_mm
    moved = _traced(FIELD_MM, blur, jnp.asarray(0.1), shift, 300, True)
    np.testing.assert_allclose(
        moments(moved).centroid_mm - still, [0.01, -0.02], atol=1e-12
    )

"""Gaussians fitted to dots: what was drawn comes back, and the nearest is taken."""

import numpy as np
import pytest
from drawn_dots import CELL_MM, HOLE_MM2, gaussian, grid_mm, pictures_of

from data_synth.bench.peers.gaussian import (
    GaussianLens,
    covariance_mm2,
    gaussian_fields,
    nearest_field,
)

IN_FOCUS = (2.8, 2000.0, 2000.0)
SPOT_MM2 = np.array([[6e-4, 2e-4], [2e-4, 3e-4]])


def field_of(picture):
    (field,) = gaussian_fields([picture])
    return field


def test_a_gaussian_photographed_returns_its_covariance():
    """Without the pixel, which is drawn by summing samples, and without the hole."""
    picture = pictures_of(gaussian(SPOT_MM2 + HOLE_MM2), IN_FOCUS)
    found = covariance_mm2(field_of(picture), np.array([3.0, -2.0]))
    assert found.shape == (3, 2, 2)
    for channel in found:
        np.testing.assert_allclose(channel, SPOT_MM2, atol=2e-6)


def test_noise_averages_out_and_a_strange_dot_is_left_out():
    picture = pictures_of(gaussian(SPOT_MM2 + HOLE_MM2), IN_FOCUS, noise=2e-3)
    picture.light[11] = np.roll(picture.light[11], 3, -1) + picture.light[11]
    found = covariance_mm2(field_of(picture), np.array([0.0, 0.0]))
    np.testing.assert_allclose(found[1], SPOT_MM2, atol=3e-5)


def test_covariance_follows_the_field_between_the_dots():
    def true(place):
        return SPOT_MM2 * (1 + 0.01 * (place @ place) / 10)

    def light(place, x, y):
        return gaussian(true(place) + HOLE_MM2)(place, x, y)

    field = field_of(pictures_of(light, IN_FOCUS))
    between = np.array([1.83, 2.0])
    np.testing.assert_allclose(
        covariance_mm2(field, between)[1], true(between), rtol=0.02
    )
    outside = covariance_mm2(field, np.array([11.0, 8.0]) * 3)
    np.testing.assert_allclose(outside, covariance_mm2(field, np.array([11.0, 8.0])))


def test_gaussians_of_round_blur_are_round():
    def disc(_, x, y):
        return (np.hypot(x, y) < 4 * CELL_MM).astype(float)

    found = covariance_mm2(
        field_of(pictures_of(disc, IN_FOCUS, hole_mm2=np.zeros((2, 2)))),
        np.array([5.0, 5.0]),
    )
    for channel in found:
        size = np.trace(channel) / 2
        assert abs(channel[0, 0] - channel[1, 1]) < 0.02 * size
        assert abs(channel[0, 1]) < 0.01 * size
        # The Gaussian nearest to a disc: with a = R^2/(2 sigma^2), 2a + 1 = exp(a).
        assert size == pytest.approx((4 * CELL_MM) ** 2 / 2.5129, rel=0.04)


def test_a_spot_sharper_than_pixel_and_hole_stays_a_spot():
    picture = pictures_of(gaussian(HOLE_MM2 / 4), IN_FOCUS)
    found = covariance_mm2(field_of(picture), np.zeros(2))
    assert (np.linalg.eigvalsh(found) > 0).all()
    assert np.sqrt(found.max()) < 0.2 * CELL_MM


def test_few_dots_get_a_polynomial_of_lower_order():
    picture = pictures_of(gaussian(SPOT_MM2 + HOLE_MM2), IN_FOCUS, grid_mm(3, 2))
    field = field_of(picture)
    assert field.order == 1
    found = covariance_mm2(field, np.zeros(2))[1]
    np.testing.assert_allclose(found, SPOT_MM2, atol=2e-6)


@pytest.fixture(scope="module")
def fields():
    settings = [(n, s, 2000.0) for n in (1.4, 2.8) for s in (2000.0, 1430.0, 3300.0)]
    places = grid_mm(3, 2)
    return gaussian_fields(
        [
            pictures_of(gaussian((1 + k) * SPOT_MM2), setting, places)
            for k, setting in enumerate(settings)
        ]
    )


def setting_of(field):
    return field.dots[:3]


def test_a_photographed_setting_has_its_own_gaussians(fields):
    for field in fields:
        assert nearest_field(fields, *setting_of(field)) is field


def test_settings_never_photographed_get_the_nearest(fields):
    # Focused at the chart, the object beyond: like the lens focused nearer.
    beyond = nearest_field(fields, 1.4, 2000.0, 3300.0)
    assert setting_of(beyond) == (1.4, 1430.0, 2000.0)
    before = nearest_field(fields, 1.4, 2000.0, 1430.0)
    assert setting_of(before) == (1.4, 3300.0, 2000.0)
    between = nearest_field(fields, 2.5, 1430.0, 2000.0)
    assert setting_of(between) == (2.8, 1430.0, 2000.0)


def test_a_psf_has_the_covariance_and_the_pixel_in_it(fields):
    lens = GaussianLens(fields, 1.4, 2000.0)
    drawn = lens.psf((0.0, 0.0), 2000.0, "b", pixel_pitch_mm=0.005, size_px=64)
    assert drawn.sum() == pytest.approx(1, abs=1e-12)
    at = (np.arange(64) + 0.5 - 32) * 0.005
    second = [
        [drawn.sum(0) @ at**2, at @ drawn @ at],
        [at @ drawn @ at, drawn.sum(1) @ at**2],
    ]
    found = covariance_mm2(fields[0], np.zeros(2))[2] + np.eye(2) * 0.005**2 / 12
    np.testing.assert_allclose(second, found, rtol=1e-3)

"""Aliasing of a mosaic: closed forms of what it does to centroid and brightness."""

import numpy as np
import pytest
from scipy.special import j1

from lensfit.fitting.wavefront.aliasing import (
    centroid_and_brightness_errors,
    sharp_edged_images,
)
from lensfit.mosaic import MOSAICS, photosites

CELLS = 24


def gaussian(sigma: float, centre: tuple[float, float]) -> np.ndarray:
    """A spot that sums to one, (1, 3, rows, columns); centre from the middle."""
    at = np.arange(CELLS) - (CELLS - 1) / 2
    x, y = np.exp(-((at - np.array(centre)[:, None]) ** 2) / (2 * sigma**2))
    spot = np.outer(y, x)
    return np.broadcast_to(spot / spot.sum(), (1, 3, CELLS, CELLS))


def own_of(mosaic) -> np.ndarray:
    return np.moveaxis(photosites(mosaic, (CELLS, CELLS)), -1, 0)[None]


@pytest.mark.parametrize("mosaic", MOSAICS)
@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.3, -0.2), (-0.45, 0.1)])
def test_aliasing_is_that_of_the_first_harmonics(mosaic, centre):
    """Poisson's summation of a Gaussian of a pixel, of period 2: to first order."""
    sigma, middle = 0.9, CELLS / 2
    moved, brightened = centroid_and_brightness_errors(
        gaussian(sigma, centre), own_of(mosaic)
    )
    damping = np.exp(-((np.pi * sigma) ** 2) / 2)
    for k in (0, 2):
        row, column = np.argwhere(own_of(mosaic)[0, k, :2, :2])[0]
        first = np.array([column, row]) + 0.5 - middle
        phase = np.pi * (np.array(centre) - first)
        np.testing.assert_allclose(
            brightened[0, k], np.prod(1 + 2 * damping * np.cos(phase)), atol=1e-3
        )
        expected = -2 * np.pi * sigma**2 * damping * np.sin(phase)
        expected /= 1 + 2 * damping * np.cos(phase)
        np.testing.assert_allclose(moved[0, k], expected, atol=2e-3)


@pytest.mark.parametrize("mosaic", MOSAICS)
def test_wide_spots_are_not_aliased(mosaic):
    moved, brightened = centroid_and_brightness_errors(
        gaussian(2.0, (0.3, 0.4)), own_of(mosaic)
    )
    np.testing.assert_allclose(moved, 0, atol=1e-5)
    np.testing.assert_allclose(brightened, 1, atol=1e-5)


def test_nothing_is_done_without_a_mosaic_or_light():
    everywhere = np.ones((1, 3, CELLS, CELLS), bool)
    moved, brightened = centroid_and_brightness_errors(
        gaussian(0.5, (0.1, 0.2)), everywhere
    )
    np.testing.assert_allclose(moved, 0, atol=1e-12)
    np.testing.assert_allclose(brightened, 1, atol=1e-12)
    moved, brightened = centroid_and_brightness_errors(
        np.zeros((1, 3, CELLS, CELLS)), own_of("rggb")
    )
    np.testing.assert_array_equal(moved, 0)
    np.testing.assert_array_equal(brightened, 1)


def test_a_hole_has_the_finest_detail_of_a_disc():
    """The transform of a disc is 2 J1(x)/x, that of its Gaussian exp(-x^2/8)."""
    radius = np.array([0.5, 0.8, 0.9])
    sigma = np.hypot(0.6, radius / 2)
    gaussians = np.concatenate([gaussian(float(s), (0.2, -0.3)) for s in sigma])
    discs = sharp_edged_images(gaussians, radius)
    np.testing.assert_allclose(discs.sum((2, 3)), 1, rtol=1e-6)
    turns = (-1.0) ** np.arange(CELLS)
    for wave, waves in (
        (np.pi, np.outer(np.ones(CELLS), turns)),
        (np.pi * 2**0.5, np.outer(turns, turns)),
    ):
        x = radius * wave
        expected = 2 * j1(x) / x * np.exp(x**2 / 8)
        before, after = (np.sum(i * waves, (2, 3))[:, 0] for i in (gaussians, discs))
        np.testing.assert_allclose(after / before, expected, rtol=1e-6)

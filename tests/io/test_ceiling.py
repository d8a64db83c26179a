"""Clipping shows in the values themselves, and nothing else is taken for it."""

import numpy as np
import pytest

from lensfit.io.image import ceiling_of

RNG = np.random.default_rng(7)
SPOTS = np.hypot(*(np.mgrid[:120, :160] % 20 - 10.0)) < 5


def _photograph(brightness, noise=0.01):
    picture = 0.02 + brightness * SPOTS[..., None] * [1.0, 0.9, 0.7]
    noisy = picture * (1 + noise * RNG.standard_normal((*SPOTS.shape, 3)))
    return noisy.astype(np.float16).astype(np.float32)


def test_an_exposure_within_range_has_no_ceiling():
    assert ceiling_of(_photograph(0.7)) == np.inf


@pytest.mark.parametrize("ceiling", [1.0, 0.37, 4000.0])
def test_the_ceiling_is_where_values_pile_up(ceiling):
    clipped = np.minimum(_photograph(1.5 * ceiling), np.float32(ceiling))
    assert ceiling_of(clipped) == np.float32(ceiling)


def test_the_lowest_ceiling_of_the_channels_counts():
    balanced = np.minimum(_photograph(1.5), np.float32(1.0)) * np.float32([2, 1, 1.5])
    assert ceiling_of(balanced) == 1.0


def test_a_few_hot_pixels_are_no_ceiling():
    hot = _photograph(0.5)
    hot[::60, ::60] = 8.0
    assert ceiling_of(hot) == np.inf


def test_a_drawn_ground_is_no_ceiling():
    assert ceiling_of(np.where(SPOTS[..., None], 0.1, 0.8)) == np.inf


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_a_picture_without_light_has_none(value):
    assert ceiling_of(np.full((9, 9, 1), value)) == np.inf

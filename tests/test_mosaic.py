"""Colour mosaics: where each channel was measured, and that phase survives cropping."""

from pathlib import Path

import numpy as np
import pytest

from lensfit.mosaic import (
    MOSAICS,
    PIXELS_PER_PHOTOSITE,
    cropped_mosaic,
    filled_in,
    letters_of,
    mosaic_of,
    photosites,
)
from lensfit.photograph import Photograph

SIZE = (11, 8)


@pytest.mark.parametrize("mosaic", MOSAICS)
def test_every_pixel_measures_one_channel(mosaic):
    own = photosites(mosaic, SIZE)
    assert own.shape == (8, 11, 3)
    np.testing.assert_array_equal(own.sum(2), 1)
    top_left = ["rgb"[own[y, x].argmax()] for y in (0, 1) for x in (0, 1)]
    assert "".join(top_left) == mosaic
    whole = photosites(mosaic, (64, 48))
    np.testing.assert_allclose(1 / whole.mean((0, 1)), PIXELS_PER_PHOTOSITE)


@pytest.mark.parametrize("mosaic", MOSAICS)
@pytest.mark.parametrize("corner", [(0, 0), (1, 0), (0, 1), (3, 1), (2, 5)])
def test_a_crop_keeps_its_photosites(mosaic, corner):
    x, y = corner
    part = photosites(mosaic, SIZE)[y:, x:]
    size = (part.shape[1], part.shape[0])
    np.testing.assert_array_equal(photosites(cropped_mosaic(mosaic, x, y), size), part)
    pixels = np.zeros((8, 11, 3), np.float32)
    whole = Photograph(pixels, Path("a.exr"), "", mosaic=mosaic)
    assert whole.cropped(x, y, 11, 8).mosaic == cropped_mosaic(mosaic, x, y)


@pytest.mark.parametrize("size", [(8, 6), (7, 6), (8, 5), (7, 5)])
@pytest.mark.parametrize("turn", [np.fliplr, np.flipud, np.rot90, np.transpose])
def test_letters_turn_as_the_picture_does(size, turn):
    own = photosites("grbg", size)
    turned = np.stack([turn(own[..., k]) for k in range(3)], -1)
    word = mosaic_of(turn(letters_of("grbg", size)))
    expected = photosites(word, (turned.shape[1], turned.shape[0]))
    np.testing.assert_array_equal(turned, expected)


def test_what_was_measured_stays_and_a_ramp_is_met():
    y, x = np.mgrid[:8, :11].astype(float)
    ramp = np.stack([x + 2 * y, 3 * x - y, 5 + 0 * x], -1)
    filled = filled_in(ramp, "gbrg")
    own = photosites("gbrg", SIZE)
    np.testing.assert_array_equal(filled[own], ramp[own].astype(np.float32))
    np.testing.assert_allclose(filled[1:-1, 1:-1], ramp[1:-1, 1:-1], atol=1e-5)
    between = np.where(own, ramp, 1e9)
    np.testing.assert_array_equal(filled_in(between, "gbrg"), filled)
    with pytest.raises(ValueError, match="no mosaic"):
        mosaic_of(np.array([["r", "r"], ["g", "b"]]))

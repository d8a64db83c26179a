"""A photograph says by its noise that colours were interpolated; others say nothing."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from lensfit.detect.mosaic_seen import mosaic_seen
from lensfit.mosaic import MOSAICS, filled_in, photosites
from lensfit.photograph import Photograph

SIZE = (320, 240)


def noisy(seed: int = 0, sigma: float = 0.01) -> np.ndarray:
    """A soft picture of three colours, with noise in every pixel."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    soft = 0.4 + 0.1 * np.sin(x / 40) * np.cos(y / 30)
    rng = np.random.default_rng(seed)
    return soft[..., None] * [0.6, 1.0, 0.8] + rng.normal(0, sigma, (*SIZE[::-1], 3))


def photograph_of(pixels: np.ndarray) -> Photograph:
    return Photograph(pixels.astype(np.float32), Path("a.exr"), "")


@pytest.mark.parametrize("mosaic", MOSAICS)
@pytest.mark.parametrize("seed", range(3))
def test_interpolation_is_seen(mosaic, seed):
    assert mosaic_seen(photograph_of(filled_in(noisy(seed), mosaic))) == mosaic


@pytest.mark.parametrize("gains", [(1, 1, 1), (2.1, 1.0, 1.6), (0.1, 1.0, 3.0)])
def test_white_balance_does_not_matter(gains):
    assert mosaic_seen(photograph_of(filled_in(noisy(), "gbrg") * gains)) == "gbrg"


def test_interpolation_along_edges_is_seen_too():
    own = photosites("rggb", SIZE)
    codes = np.rint((noisy() * own).sum(2) * 4000).astype(np.uint16)
    pixels = cv2.demosaicing(codes, cv2.COLOR_BayerBG2RGB_EA)
    assert mosaic_seen(photograph_of(pixels / 4000)) == "rggb"


@pytest.mark.parametrize("seed", range(10))
def test_noise_of_its_own_in_every_pixel_is_no_mosaic(seed):
    assert mosaic_seen(photograph_of(noisy(seed))) is None


def test_nothing_is_said_of_pictures_that_tell_nothing():
    flat = np.full((*SIZE[::-1], 3), 0.4)
    assert mosaic_seen(photograph_of(flat)) is None
    assert mosaic_seen(photograph_of(noisy()[..., :1])) is None
    assert mosaic_seen(photograph_of(filled_in(noisy()[:20, :20], "rggb"))) is None
    # Columns and rows of a period of two, as in a drawing, but no mosaic.
    stripes = noisy()
    stripes[:, ::2] += 0.1
    assert mosaic_seen(photograph_of(stripes)) is None
    larger = cv2.resize(noisy()[::2, ::2], SIZE, interpolation=cv2.INTER_LINEAR)
    assert mosaic_seen(photograph_of(larger)) is None


def test_what_is_stated_or_lost_is_not_told():
    seen = photograph_of(filled_in(noisy(), "rggb"))
    assert mosaic_seen(replace(seen, mosaic="rggb")) is None
    assert mosaic_seen(replace(seen, chroma_subsampled=True)) is None
    assert mosaic_seen(replace(seen, metadata={"orientation": 6})) is None

"""Colour stored at lower resolution: what a JPEG file gives back is predicted."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from lensfit.chroma import ChromaBlocks, codes_after_storage
from lensfit.io.raster import read_raster, upright_pixels

SIZES = [(48, 64), (47, 63)]
SAMPLINGS = {"4:2:0": (2, 2), "4:2:2": (2, 1)}


def fringed(shape: tuple[int, int]) -> np.ndarray:
    """A picture whose channels are shifted against each other, height x width x 3."""
    height, width = shape
    noise = np.random.default_rng(3).normal(size=(height + 2, width + 2))
    smooth = gaussian_filter(noise, 1.5)
    smooth = 0.5 + 0.1 * smooth / smooth.std()
    moved = [smooth[k : k + height, k : k + width] for k in range(3)]
    return np.stack(moved, -1).clip(0.1, 0.9)


def after(codes: np.ndarray, blocks: ChromaBlocks) -> np.ndarray:
    moved = np.moveaxis(codes, -1, 0)[None]
    found = codes_after_storage(moved, np.zeros((1, 2), int), blocks)
    return np.moveaxis(found[0], 0, -1)


@pytest.mark.parametrize("shape", SIZES)
@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_a_file_gives_back_what_is_predicted(sampling: str, orientation: int, shape):
    codes = np.round(255 * fringed(shape)).astype(np.uint8)
    exif = Image.Exif()
    exif[0x112] = orientation
    file = io.BytesIO()
    Image.fromarray(codes).save(
        file, "jpeg", quality=100, subsampling=sampling, exif=exif
    )
    raster = read_raster(file.getvalue())
    assert raster.chroma is not None
    upright = upright_pixels(codes, orientation)
    turned = orientation >= 5
    size = SAMPLINGS[sampling]
    assert raster.chroma.size_px == (size[::-1] if turned else size)
    lost = np.std(raster.codes - upright.astype(float))
    missed = np.std(raster.codes - after(upright.astype(float), raster.chroma))
    # Rounding three times, to and from brightness and colour, leaves .6 to .8.
    assert missed < 0.9
    assert lost > 2 * missed


def test_every_pixel_has_its_colour_at_4_4_4():
    file = io.BytesIO()
    Image.fromarray(np.zeros((16, 16, 3), np.uint8)).save(file, "jpeg", subsampling=0)
    assert read_raster(file.getvalue()).chroma is None


@pytest.mark.parametrize("size", [(2, 2), (2, 1), (4, 1), (4, 2)])
def test_what_has_no_fringe_stays(size: tuple[int, int]):
    grey = np.repeat(fringed((20, 24))[..., 1:2], 3, 2)
    np.testing.assert_allclose(after(grey, ChromaBlocks(size)), grey, atol=1e-12)
    even = np.ones((20, 24, 1)) * [0.2, 0.5, 0.7]
    np.testing.assert_allclose(after(even, ChromaBlocks(size)), even, atol=1e-12)


@pytest.mark.parametrize("corner", [(0, 0), (7, 4), (5, 9), (2, 3)])
@pytest.mark.parametrize("size", [(2, 2), (2, 1), (4, 1)])
def test_a_patch_is_a_part_of_its_picture(size, corner):
    codes, blocks = fringed((48, 64)), ChromaBlocks(size)
    whole = after(codes, blocks)
    x, y = corner
    part = np.moveaxis(codes[y : y + 24, x : x + 24], -1, 0)[None]
    found = codes_after_storage(part, np.array([corner]), blocks)[0]
    inner = slice(4, -4)
    expected = np.moveaxis(whole[y : y + 24, x : x + 24], -1, 0)
    np.testing.assert_allclose(
        found[:, inner, inner], expected[:, inner, inner], atol=1e-12
    )
    cropped = after(codes[y:, x:], blocks.cropped(x, y))
    np.testing.assert_allclose(cropped[4:-4, 4:-4], whole[y:, x:][4:-4, 4:-4])

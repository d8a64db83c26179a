"""Colour that JPEG stored in blocks is put back where brightness shows the way."""

import io

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter

from lensfit import chroma
from lensfit.chroma import ChromaBlocks, codes_with_fringes
from lensfit.io.raster import Raster, read_raster, upright_pixels

SAMPLINGS = {"4:2:0": (2, 2), "4:2:2": (2, 1)}
FINE = 8
SHIFTS_PX = (0.6, 0.0, -0.9)
BLURS_PX = (0.75, 0.6, 0.85)


def chart(shape: tuple[int, int]) -> np.ndarray:
    """Dark dots behind a lens with lateral and axial colour, height x width x 3."""
    height, width = shape
    y, x = np.mgrid[: height * FINE, : width * FINE] / FINE
    channels = []
    for shift_px, blur_px in zip(SHIFTS_PX, BLURS_PX, strict=True):
        across = (x - shift_px + y / 20) % 24 - 12
        down = (y - shift_px / 2 - x / 25) % 24 - 12
        light = np.where(np.hypot(across, down) < 7, 0.15, 0.85)
        light = gaussian_filter(light, blur_px * FINE)
        channels.append(light.reshape(height, FINE, width, FINE).mean((1, 3)))
    return np.stack(channels, -1).astype(np.float32)


def through_jpeg(codes: np.ndarray, sampling: str, orientation: int = 1) -> Raster:
    exif = Image.Exif()
    exif[0x112] = orientation
    file = io.BytesIO()
    picture = Image.fromarray(np.round(255 * codes).astype(np.uint8))
    picture.save(file, "jpeg", quality=100, subsampling=sampling, exif=exif)
    return read_raster(file.getvalue())


def with_fringes(codes: np.ndarray, blocks: ChromaBlocks) -> np.ndarray:
    """Of codes from 0 to 1."""
    given = np.round(codes * 65535).astype(np.uint16)
    return codes_with_fringes(given, blocks) / 65535


def of_edges(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error[6:-6, 6:-6] ** 2)))


@pytest.mark.parametrize("shape", [(72, 96), (71, 95)])
@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("sampling", SAMPLINGS)
def test_most_of_what_was_lost_comes_back(sampling: str, orientation: int, shape):
    codes = chart(shape)
    raster = through_jpeg(codes, sampling, orientation)
    assert raster.chroma is not None
    size = SAMPLINGS[sampling]
    assert raster.chroma.size_px == (size[::-1] if orientation >= 5 else size)
    before = upright_pixels(codes, orientation)
    read = raster.codes.astype(np.float32) / 255
    found = with_fringes(read, raster.chroma)
    assert found.shape == before.shape
    assert of_edges(found - before) < 0.45 * of_edges(read - before)


def test_clipped_pixels_stay():
    codes = np.minimum(np.round(300 * chart((72, 96))), 255).astype(np.uint8)
    found = codes_with_fringes(codes, ChromaBlocks((2, 2)))
    clipped = (codes == 255).any(-1)
    assert 0.05 < clipped.mean() < 0.95
    np.testing.assert_array_equal(found[clipped], codes[clipped].astype(int) * 257)


def test_every_pixel_has_its_colour_at_4_4_4():
    assert through_jpeg(chart((32, 32)), "4:4:4").chroma is None


@pytest.mark.parametrize("size", [(2, 2), (2, 1), (4, 1), (4, 2)])
def test_brightness_stays(size: tuple[int, int]):
    codes = chart((72, 96))
    luma = np.array([0.299, 0.587, 0.114], np.float32)
    found = with_fringes(codes, ChromaBlocks(size))
    within = ((found > 0) & (found < 1)).all(-1)  # no code is beyond
    assert within.mean() > 0.99
    np.testing.assert_allclose(
        (found @ luma)[within], (codes @ luma)[within], atol=3e-5
    )


@pytest.mark.parametrize("size", [(2, 2), (2, 1), (4, 1), (4, 2)])
def test_what_has_no_fringe_stays(size: tuple[int, int]):
    grey = np.repeat(chart((72, 96))[..., 1:2], 3, 2)
    np.testing.assert_allclose(with_fringes(grey, ChromaBlocks(size)), grey, atol=3e-5)
    even = np.ones((40, 56, 1), np.float32) * np.array([0.2, 0.5, 0.7], np.float32)
    np.testing.assert_allclose(with_fringes(even, ChromaBlocks(size)), even, atol=3e-5)


def test_grain_is_made_no_coarser():
    """Where there is nothing but noise next to nothing is put back."""
    noise = np.random.default_rng(2).normal(0, 0.02, (96, 128, 3)).astype(np.float32)
    raster = through_jpeg(0.5 + noise, "4:2:0")
    assert raster.chroma is not None
    read = raster.codes.astype(np.float32) / 255
    found = with_fringes(read, raster.chroma)
    assert of_edges(found - read) < 0.4 * of_edges(noise)
    assert of_edges(found - 0.5 - noise) < 1.02 * of_edges(read - 0.5 - noise)


def test_a_picture_without_edges_stays():
    ramp = np.linspace(0, 1, 64)
    codes = np.stack(np.broadcast_arrays(ramp, ramp[:, None], 0.5), -1)
    raster = through_jpeg(codes, "4:2:0")
    assert raster.chroma is not None
    read = raster.codes.astype(np.float32) / 255
    assert np.abs(with_fringes(read, raster.chroma) - read).max() < 8 / 255


def test_tiles_do_not_show(monkeypatch: pytest.MonkeyPatch):
    noise = np.random.default_rng(1).normal(size=(600, 700))
    light = gaussian_filter(noise, 1.5)
    light = 0.5 + 0.1 * light / light.std()
    codes = np.stack([np.roll(light, k, (0, 1)) for k in (-1, 0, 1)], -1).clip(0.1, 0.9)
    raster = through_jpeg(codes, "4:2:0")
    assert raster.chroma is not None
    found = codes_with_fringes(raster.codes, raster.chroma) / 65535
    monkeypatch.setattr(chroma, "_TILE_CELLS", 1000)
    of_one = codes_with_fringes(raster.codes, raster.chroma) / 65535
    assert of_edges(of_one - raster.codes / 255) > 0.005
    assert np.abs(found - of_one).max() < 0.003


@pytest.mark.parametrize("corner", [(7, 4), (5, 9), (2, 3)])
def test_blocks_begin_where_they_do(corner: tuple[int, int]):
    x, y = corner
    codes = chart((96, 128))
    raster = through_jpeg(codes, "4:2:0")
    read = raster.codes.astype(np.float32) / 255
    blocks = ChromaBlocks((2, 2), (-x % 2, -y % 2))
    part = with_fringes(read[y:, x:], blocks)
    whole = with_fringes(read, ChromaBlocks((2, 2)))[y:, x:]
    assert of_edges(part - whole) < 0.1 * of_edges(read[y:, x:] - codes[y:, x:])

"""A camera's sharpening is told by its halos and taken off; blur alone is none.

Charts are drawn here on fine pixels, blurred by discs or Gaussians, averaged over
pixels, and sharpened in some power of the light as cameras do.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest

from lensfit.detect.sharpening import (
    UnsharpMask,
    edge_profile,
    sharpening_of,
    without_sharpening,
)
from lensfit.photograph import Photograph

FINE, SIZE = 6, (240, 320)
DARK, BRIGHT = 0.05, 0.6


def chart(blur_px: float, *, disc: bool = False) -> np.ndarray:
    """Linear light of dark dots of 36 px on white, behind a Gaussian or a disc of the
    same variance."""
    height, width = (FINE * n for n in SIZE)
    y, x = np.mgrid[:height, :width] / FINE
    pitch = 60.0
    away = np.hypot((x + y / 20) % pitch - pitch / 2, (y - x / 25) % pitch - pitch / 2)
    light = np.where(away < 18, DARK, BRIGHT).astype(np.float32)
    if disc:
        return behind_disc(light, 2 * blur_px)
    return on_pixels(cv2.GaussianBlur(light, (0, 0), blur_px * FINE))


def behind_disc(light: np.ndarray, radius_px: float) -> np.ndarray:
    reach = int(radius_px * FINE) + 1
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    kernel = (np.hypot(u, v) <= radius_px * FINE).astype(np.float32)
    return on_pixels(cv2.filter2D(light, -1, kernel / kernel.sum()))


def on_pixels(light: np.ndarray) -> np.ndarray:
    return light.reshape(SIZE[0], FINE, SIZE[1], FINE).mean((1, 3))


def sharpened(light: np.ndarray, mask: UnsharpMask) -> np.ndarray:
    coded = light ** (1 / mask.gamma)
    blurred = cv2.GaussianBlur(coded, (0, 0), mask.radius_px)
    coded = coded + mask.amount * (coded - blurred)
    return np.sign(coded) * np.abs(coded) ** mask.gamma


def photographed(light: np.ndarray, noise: float = 0.0) -> Photograph:
    light = light + noise * np.random.default_rng(0).normal(size=light.shape)
    pixels = light.astype(np.float32)[..., None].repeat(3, -1)
    return Photograph(pixels, Path("chart.jpg"), "", "srgb")


def found_in(*photographs: Photograph):
    profiles = [edge_profile(one) for one in photographs]
    return sharpening_of(profiles)


@pytest.mark.parametrize("blur_px", [0.4, 0.8, 1.5])
@pytest.mark.parametrize("disc", [False, True])
def test_blur_alone_is_no_sharpening(blur_px: float, disc: bool):
    photograph = photographed(chart(blur_px, disc=disc), 0.004)
    assert edge_profile(photograph) is not None
    assert found_in(photograph) is None


def lines(width_px: float, blur_px: float, *, dark: bool) -> np.ndarray:
    """Linear light of a slightly turned line grid behind a disc."""
    height, width = (FINE * n for n in SIZE)
    y, x = np.mgrid[:height, :width] / FINE
    across = [(x + y / 20) % 30, (y - x / 25) % 30]
    drawn = np.min(np.abs(np.array(across) - 15), 0) < width_px / 2
    light = np.where(drawn != dark, BRIGHT, DARK).astype(np.float32)
    return behind_disc(light, 2 * blur_px)


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width_px", [2.0, 4.0, 7.0])
@pytest.mark.parametrize("blur_px", [0.4, 1.0, 2.0])
def test_where_lines_cross_is_no_halo(width_px: float, blur_px: float, *, dark: bool):
    """Light of two lines comes together there, and less of it farther along them."""
    photograph = photographed(lines(width_px, blur_px, dark=dark), 0.004)
    assert found_in(photograph) is None


@pytest.mark.parametrize(
    "mask",
    [
        UnsharpMask(0.6, 1.5, 2.2),
        UnsharpMask(1.5, 1.0, 1.6),
        UnsharpMask(3.0, 0.7, 1.8),
    ],
)
@pytest.mark.parametrize("disc", [False, True])
def test_what_sharpened_is_taken_off(mask: UnsharpMask, disc: bool):
    before = chart(0.8, disc=disc)
    photograph = photographed(sharpened(before, mask), 0.002)
    sharpening = found_in(photograph)
    assert sharpening is not None
    assert sharpening.mask is not None
    after = without_sharpening(photograph, sharpening.mask).pixels[..., 1]
    inner = (slice(8, -8), slice(8, -8))
    off, left = (
        np.linalg.norm((one - before)[inner])
        for one in (photograph.pixels[..., 1], after)
    )
    assert left < 0.2 * off
    assert max(edge_profile(photographed(after)).halos) < 0.02  # pyright: ignore


def test_photographs_out_of_focus_share_the_filter_of_those_in_focus():
    mask = UnsharpMask(1.5, 1.0, 2.2)
    in_focus, soft = (
        photographed(sharpened(chart(blur_px), mask)) for blur_px in (0.7, 3.0)
    )
    assert found_in(soft) is None
    assert found_in(in_focus, soft) == found_in(in_focus)


@pytest.mark.parametrize("side", ["dark", "bright"])
def test_of_halos_that_a_camera_limits_on_one_side_no_more_is_made(side: str):
    before = chart(0.6)
    limited = sharpened(before, UnsharpMask(2.0, 0.8, 2.2))
    if side == "bright":
        limited = np.minimum(limited, BRIGHT)
    else:
        limited = np.maximum(limited, DARK)
    photograph = photographed(limited)
    sharpening = found_in(photograph)
    assert sharpening is not None
    if sharpening.mask is None:
        return
    after = without_sharpening(photograph, sharpening.mask).pixels[..., 1]
    off, left = (np.linalg.norm((one - before)[8:-8, 8:-8]) for one in (limited, after))
    assert left < off


def test_where_black_ink_cuts_halos_off_the_bright_ones_show_the_mask():
    mask = UnsharpMask(2.5, 1.0, 1.6)
    before = np.maximum((chart(0.8) - DARK) / (BRIGHT - DARK) * 0.7, 0.0)
    cut_off = np.maximum(sharpened(before, mask), 0.0)
    photograph = photographed(cut_off)
    sharpening = found_in(photograph)
    assert sharpening is not None
    assert sharpening.mask is not None
    after = without_sharpening(photograph, sharpening.mask).pixels[..., 1]
    off, left = (np.linalg.norm((one - before)[8:-8, 8:-8]) for one in (cut_off, after))
    assert left < 0.4 * off


def test_clipped_pixels_stay_clipped():
    photograph = photographed(np.full(SIZE, 1.0))
    photograph.pixels[:, : SIZE[1] // 2] = 0.1
    clipped = Photograph(
        photograph.pixels, photograph.path, "", "srgb", saturation=0.99
    )
    after = without_sharpening(clipped, UnsharpMask(2.0, 1.0, 2.0))
    np.testing.assert_array_equal(
        after.pixels >= 0.99, clipped.pixels >= clipped.saturation
    )


def test_a_picture_without_edges_says_nothing():
    assert edge_profile(photographed(np.full(SIZE, 0.4), 0.01)) is None
    assert sharpening_of([]) is None

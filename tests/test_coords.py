"""Pixels, millimetres, windows and UV agree about where things are.

Samples over another window: the same pixel keeps its value wherever it lies.
"""

import numpy as np
import pytest

from lensfit.coords import (
    Window,
    mm_from_px,
    pixels_over_window,
    px_from_mm,
    px_from_uv,
    uv_from_px,
)

WINDOW = Window(-48, -27, 1007, 566)


def test_window_corners_are_inclusive():
    assert (WINDOW.width, WINDOW.height) == (1056, 594)
    assert Window.of_size(960, 540) == Window(0, 0, 959, 539)
    assert Window.of_size(960, 540).grown(48, 27) == WINDOW
    assert WINDOW.grown(-48, -27) == Window.of_size(960, 540)


def test_pixel_centres_are_half_way():
    centres = Window(-1, 2, 1, 3).pixel_centres()
    assert centres.shape == (2, 3, 2)
    assert centres[0, 0].tolist() == [-0.5, 2.5]
    assert centres[-1, -1].tolist() == [1.5, 3.5]


def test_sensor_centre_is_the_image_centre_and_y_runs_down():
    size, sensor = (1920, 1080), (24.0, 13.5)
    corners = np.array([[960.0, 540.0], [0.0, 0.0], [1920.0, 1080.0]])
    np.testing.assert_allclose(
        mm_from_px(corners, size, sensor),
        [[0.0, 0.0], [-12.0, -6.75], [12.0, 6.75]],
        atol=1e-12,
    )


def test_uv_of_the_frame_corners_and_the_first_pixel():
    window = Window(10, 20, 13, 21)
    corners = np.array([[10.0, 20.0], [14.0, 22.0], [10.5, 20.5]])
    assert uv_from_px(corners, window).tolist() == [[0, 1], [1, 0], [0.125, 0.75]]


def test_overscan_exceeds_the_unit_square():
    uv = uv_from_px(WINDOW.pixel_centres(), Window.of_size(960, 540))
    assert uv.min() < 0
    assert uv.max() > 1


@pytest.mark.parametrize("seed", range(3))
def test_inverse_pairs(seed: int):
    points = np.random.default_rng(seed).uniform(-500, 5000, (50, 2))
    size, sensor = (4096, 2160), (36.7, 19.35)
    np.testing.assert_allclose(
        px_from_mm(mm_from_px(points, size, sensor), size, sensor), points, atol=1e-9
    )
    np.testing.assert_allclose(
        px_from_uv(uv_from_px(points, WINDOW), WINDOW), points, atol=1e-9
    )


def test_opencv_pixels_are_half_a_pixel_off():
    # OpenCV's 0 is the centre of the first pixel: u = (x_cv + 0.5) / width.
    x_cv, y_cv = 3.0, 1.0
    uv = uv_from_px(np.array([x_cv + 0.5, y_cv + 0.5]), Window.of_size(8, 4))
    assert uv.tolist() == [(x_cv + 0.5) / 8, 1 - (y_cv + 0.5) / 4]


OWN = Window(-2, 3, 5, 8)


def numbered(window):
    """Samples that tell their own place, with a channel axis."""
    y = np.arange(window.y_min, window.y_max + 1)[:, None]
    x = np.arange(window.x_min, window.x_max + 1)
    return np.stack([100 * y + x, 0 * y + x], -1).astype(np.float32)


@pytest.mark.parametrize(
    "wanted",
    [
        OWN,
        Window(0, 4, 3, 6),
        Window(-4, 0, 9, 12),
        Window(2, 6, 9, 12),
        Window(20, 20, 22, 22),
    ],
    ids=["same", "inside", "around", "overlapping", "apart"],
)
def test_every_pixel_keeps_its_value_and_the_others_are_missing(wanted):
    found = pixels_over_window(numbered(OWN), OWN, wanted, np.nan)
    exact = numbered(wanted)
    x, y = exact[..., 1], (exact[..., 0] - exact[..., 1]) / 100
    inside = (x >= OWN.x_min) & (x <= OWN.x_max) & (y >= OWN.y_min) & (y <= OWN.y_max)
    assert found.shape == exact.shape
    assert (found[inside] == exact[inside]).all()
    assert np.isnan(found[~inside]).all()


def test_a_part_is_a_view_and_not_a_second_copy():
    samples = numbered(OWN)
    assert np.shares_memory(
        pixels_over_window(samples, OWN, Window(0, 4, 3, 6)), samples
    )
    assert not pixels_over_window(samples, OWN, Window(6, 9, 7, 9)).any()

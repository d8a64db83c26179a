"""Overscan to the pixel: what it holds is enough, and one pixel less is not."""

from typing import get_args

import numpy as np
import pytest
from ideal_lens import ideal_lens
from radial_lens import IdentityLens, RadialLens

from lensfit.coords import Window
from lensfit.rendering.circle import Circle
from lensfit.rendering.filters import Filter
from lensfit.rendering.frame import render
from lensfit.rendering.overscan import (
    Margins,
    cg_camera,
    margins_read,
    overscan_factor,
    window_of_percent,
)
from lensfit.rendering.render_stages import Switches
from lensfit.rendering.uv import PlateGeometry

DISPLAY = Window.of_size(180, 120)
FAR = 60
"""Pixels around the frame of a plate that lacks nothing."""
ROUNDING = 5e-6
SWITCHES = Switches(falloff=False, defocus=False)


def of_margins(margins: Margins) -> Window:
    return Window(
        DISPLAY.x_min - margins.left,
        DISPLAY.y_min - margins.top,
        DISPLAY.x_max + margins.right,
        DISPLAY.y_max + margins.bottom,
    )


def frame(pixels, window, lens, method):
    return render(
        pixels,
        None,
        lens,
        data_window=window,
        display_window=DISPLAY,
        switches=SWITCHES,
        method=method,
    )


def plate(kept: Window, beyond: float) -> np.ndarray:
    """A grey plate with one light, and another grey beyond a window."""
    everything = DISPLAY.grown(FAR, FAR)
    pixels = np.full((everything.height, everything.width, 3), beyond, np.float32)
    rows = slice(kept.y_min + FAR, kept.y_max + 1 + FAR)
    columns = slice(kept.x_min + FAR, kept.x_max + 1 + FAR)
    pixels[rows, columns] = 1
    pixels[FAR + 60, FAR + 90] = 20
    return pixels


def changed_from_beyond(kept: Window, lens, method) -> float:
    """How much the frame changes when everything beyond a window does."""
    everything = DISPLAY.grown(FAR, FAR)
    grey, other = (
        frame(plate(kept, beyond), everything, lens, method) for beyond in (1.0, 9.0)
    )
    return float(np.abs(other - grey).max())


def less(window: Window, side: int) -> Window:
    """Without one column or row on a side: left, top, right, bottom."""
    step = 1 if side < 2 else -1
    return Window(*(v + step * (i == side) for i, v in enumerate(window)))


LENSES = {
    "weak": RadialLens(k=0.031),
    "strong": RadialLens(k=0.079),
    "coloured": RadialLens(k=0.052, lateral=0.0113),
    "pincushion": RadialLens(k=-0.04, lateral=0.03),
}


def lenses_and_filters():
    """Every filter with every lens."""
    for name, lens in LENSES.items():
        for method in get_args(Filter):
            yield pytest.param(lens, method, id=f"{name}-{method}")


@pytest.mark.slow
@pytest.mark.parametrize(("lens", "method"), list(lenses_and_filters()))
def test_the_frame_reads_these_pixels_and_no_other(lens, method):
    window = of_margins(margins_read(lens, DISPLAY, method=method))
    assert changed_from_beyond(window, lens, method) < ROUNDING
    for side in range(4):
        if window[side] == DISPLAY[side]:
            continue  # looks inward there
        # The outermost weights of the long filter are a hundred-thousandth.
        seen = ROUNDING if method == "sinc-16" else 1e-3
        assert changed_from_beyond(less(window, side), lens, method) > seen


def test_such_a_plate_has_no_black_border_and_a_narrower_one_has():
    lens = RadialLens(k=0.08, lateral=0.004)
    window = of_margins(margins_read(lens, DISPLAY))
    full = np.ones((window.height, window.width, 3), np.float32)
    assert np.abs(frame(full, window, lens, "cubic") - 1).max() < 1e-6
    narrow = window.grown(-3, -3)
    lacking = frame(full[3:-3, 3:-3], narrow, lens, "cubic")
    assert lacking.min() < 0.9


def test_where_the_map_minifies_the_whole_pixel_counts():
    lens = RadialLens(k=0.2)  # steps of 1.6 px in the corners
    window = of_margins(margins_read(lens, DISPLAY))
    assert changed_from_beyond(window, lens, "cubic") < ROUNDING
    assert changed_from_beyond(window.grown(-2, -2), lens, "cubic") > 1e-3


def test_a_lens_without_distortion_needs_none():
    assert margins_read(IdentityLens(), DISPLAY) == (0, 0, 0, 0, False)
    camera = cg_camera(Margins(0, 0, 0, 0), DISPLAY, 36.0)
    assert camera.percent == 0
    assert camera.render_px == (180, 120)
    assert camera.sensor_mm == pytest.approx((36, 24))


def test_what_no_plate_can_hold_is_said():
    assert margins_read(RadialLens(k=0.1, valid_radius=0.9), DISPLAY).missing


@pytest.mark.parametrize("margins", [(5, 3, 4, 6), (0, 1, 0, 0), (31, 0, 7, 2)])
@pytest.mark.parametrize("size", [(180, 120), (4096, 3072), (1921, 803)])
def test_the_camera_is_the_smallest_that_holds_the_margins(margins, size):
    display = Window.of_size(*size)
    camera = cg_camera(Margins(*margins), display, 25.0)
    window = camera.data_window
    assert window == window_of_percent(display, camera.percent)
    left, top, right, bottom = margins
    assert window.x_min <= -left
    assert window.y_min <= -top
    assert window.x_max >= size[0] - 1 + right
    assert window.y_max >= size[1] - 1 + bottom
    # On one axis not a pixel more; photosites keep their size.
    assert window.x_min == -max(left, right) or window.y_min == -max(top, bottom)
    for length_mm, count in zip(camera.sensor_mm, camera.render_px, strict=True):
        assert length_mm / count == pytest.approx(25.0 / size[0], rel=1e-12)
    assert camera.percent * 1e4 == pytest.approx(round(camera.percent * 1e4), abs=1e-6)


def test_blur_reaches_further_by_its_radius():
    ideal = IdentityLens()
    assert margins_read(ideal, DISPLAY, blur_px=6.2)[:4] == (7, 7, 7, 7)
    barrel = RadialLens(k=0.08)
    sharp, blurred = (
        margins_read(barrel, DISPLAY),
        margins_read(barrel, DISPLAY, blur_px=10),
    )
    # The barrel stretches what is beyond the frame, so 10 px of picture are more.
    assert all(10 <= b - s <= 14 for s, b in zip(sharp[:4], blurred[:4], strict=True))


def test_depth_of_field_reads_no_further_than_is_said():
    """An ideal lens out of focus: pixels beyond the margin do not matter, and within
    it they do."""
    lens = ideal_lens()
    radius = abs(Circle.of(lens, PlateGeometry.of(lens, DISPLAY)).radius_px(np.inf))
    margins = margins_read(lens, DISPLAY, blur_px=float(radius))
    assert 2 < margins.left < 40

    def seen(kept):
        frames = []
        for beyond in (1.0, 3.0):
            pixels = plate(kept, beyond)
            pixels[pixels == 20] = 1
            everything = DISPLAY.grown(FAR, FAR)
            depth = np.full(pixels.shape[:2], 1e9, np.float32)
            frames.append(
                render(
                    pixels,
                    depth,
                    lens,
                    data_window=everything,
                    display_window=DISPLAY,
                    switches=Switches(falloff=False),
                )
            )
        return float(np.abs(frames[1] - frames[0]).max())

    assert seen(of_margins(margins)) < 5e-3
    assert seen(of_margins(margins).grown(-3, -3)) > 2e-2


def test_overscan_is_what_the_corner_of_a_barrel_lens_needs():
    # The corner is at r = 1.
    factor = overscan_factor(RadialLens(k=0.1), DISPLAY)
    assert factor == pytest.approx(1.1, abs=1e-9)


def test_pincushion_needs_no_overscan():
    assert overscan_factor(RadialLens(k=-0.1), DISPLAY) == 1


def test_lateral_colour_counts_for_the_overscan():
    plain = overscan_factor(RadialLens(k=0.1), DISPLAY)
    coloured = overscan_factor(RadialLens(k=0.1, lateral=0.01), DISPLAY)
    assert coloured > plain + 0.008

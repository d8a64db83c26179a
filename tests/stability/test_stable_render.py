"""Pictures that are hard to render: NaN, 1e-8 to 1e5, one pixel, 16k, no depth."""

import math
from dataclasses import replace
from functools import cache

import hypothesis.strategies as st
import jax.numpy as jnp
import numpy as np
import pytest
from examples import examples
from hypothesis import given

from lensfit.coords import Window
from lensfit.errors import LensfitError
from lensfit.io.depth_channel import DepthMeaning, perpendicular_mm, without_nan
from lensfit.lens import Lens
from lensfit.optics.distortion import no_distortion
from lensfit.optics.falloff import Illumination
from lensfit.optics.lateral import ChannelShift
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.rendering.filters import Filter
from lensfit.rendering.frame import render
from lensfit.rendering.resample import resample
from lensfit.rendering.uv import SourceMap, stmap_redistort
from lensfit.rendering.warp import warp

WIDTH, HEIGHT = 160, 112
FOCUS_MM = 350.0
REACH_PX = 8
Y, X = np.mgrid[:HEIGHT, :WIDTH]


@cache
def bending() -> Lens:
    """Barrel distortion, lateral colour, fall-off; no depth of field of its own."""
    shift = ChannelShift(jnp.asarray([1e-3, 0.0]), jnp.zeros(2), jnp.asarray(1.05))
    ideal = no_distortion(30.0, 21.0)
    control = jnp.asarray([[0.1, 0.4, 0.9]] * 3)
    return Lens(
        distortion=replace(ideal, radial=jnp.asarray([-0.12, 0.02])),
        lateral_colour=(shift, shift),
        illumination=Illumination(control, jnp.asarray(22.0)),
        entrance_pupil_offset_mm=jnp.zeros(()),
        sensor_size_mm=(36.0, 25.2),
        focal_length_mm=30.0,
    )


@cache
def blurring(width: int = WIDTH, height: int = HEIGHT) -> Lens:
    """An ideal 50 mm f/2 focused near by."""
    camera = ThinCamera(50.0, 2.0, FOCUS_MM / 1000, 36.0, width, height)
    return thin_lens_preset(camera).at(focus_distance_mm=FOCUS_MM)


def depth_of(radius_px: float, width: int = WIDTH) -> float:
    """Distance whose blur has this radius, positive in front of the focus."""
    return 1 / (1 / FOCUS_MM + radius_px / (50 / 2 * 50 / (2 * 36 / width)))


DEPTH = np.full((HEIGHT, WIDTH), depth_of(5.0), np.float32)


def smooth(phase: float = 0.0) -> np.ndarray:
    """A picture between .1 and .9 without anything that glares."""
    planes = [np.sin(X / (9 + c) + phase) * np.cos(Y / 7 - phase) for c in range(3)]
    return (0.5 + 0.4 * np.stack(planes, -1)).astype(np.float32)


def noise(seed: int) -> np.ndarray:
    """A picture between .2 and .5 without any structure."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.2, 0.5, (HEIGHT, WIDTH, 3)).astype(np.float32)


def shown(picture: np.ndarray, blurred: bool) -> np.ndarray:
    """Through the lens that bends, or the one that blurs."""
    return (
        render(picture, DEPTH, blurring())
        if blurred
        else render(picture, None, bending())
    )


@pytest.mark.parametrize("blurred", [False, True], ids=["warp", "defocus"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_no_number_in_a_plate(value: float, blurred: bool, measured):
    """NaN or infinity in one pixel: stays within the filter (6 px across) without
    depth, is black light with it; the rest of the frame is as it was."""
    picture = smooth()
    picture[50, 70] = value
    found, clean = shown(picture, blurred), shown(smooth(), blurred)
    y, x = np.nonzero(~np.isfinite(found).all(-1))
    reach = max(np.ptp(y) + 1, np.ptp(x) + 1) if len(y) else 0
    measured("pixels across that are no number", reach, 0 if blurred else 6)
    away = np.hypot(X - 70, Y - 50) > REACH_PX
    measured("change elsewhere", np.abs(found - clean)[away].max(), 1e-5)


@pytest.mark.parametrize("blurred", [False, True], ids=["warp", "defocus"])
@pytest.mark.parametrize("exposure", [1e-8, 1e-4, 2.0])
def test_exposures(exposure: float, blurred: bool, measured):
    """Radiance of 1e-9 to 2: the same frame, times the exposure."""
    scaled = shown(smooth() * np.float32(exposure), blurred) / np.float32(exposure)
    measured("relative", np.abs(scaled - shown(smooth(), blurred)).max(), 1e-5)


def test_a_warp_at_any_exposure(measured):
    """Radiance of 1e4 to 1e5 without depth (above white the filter is held within a
    stop of its neighbours): the same frame of a smooth plate, times the exposure."""
    scaled = shown(smooth() * np.float32(1e5), False) / np.float32(1e5)
    measured("relative", np.abs(scaled - shown(smooth(), False)).max(), 1e-4)


@pytest.mark.parametrize("exposure", [16.0, 1e5])
def test_a_bright_texture_out_of_focus(exposure: float, measured):
    """Radiance of 3 to 5e4 all over a plate of noise, out of focus (its lights are
    blurred one by one): the same frame, times the exposure, 20 px from the border."""
    inner = (slice(20, -20), slice(20, -20))
    picture = noise(0) + noise(1) - 0.35
    scaled = shown(picture * np.float32(exposure), True)[inner] / np.float32(exposure)
    plain = shown(picture, True)[inner]
    measured("rms, relative", np.sqrt(np.mean((scaled / plain - 1) ** 2)), 0.01)
    measured("light, relative", abs(scaled.mean() / plain.mean() - 1), 2e-3)


@pytest.mark.parametrize("blurred", [False, True], ids=["warp", "defocus"])
def test_1e_8_beside_1e5(blurred: bool, measured):
    """Radiance of 1e-8 beside 1e5 in one plate: dark stays dark (never negative, and
    off by 3e-7 of the bright at most), bright stays bright."""
    picture = np.full((HEIGHT, WIDTH, 3), 1e-8, np.float32)
    picture[:, WIDTH // 2 :] = 1e5
    found = shown(picture, blurred)
    assert np.isfinite(found).all()
    dark = found[:, 20 : WIDTH // 2 - 2 * REACH_PX]
    measured("below zero", max(0.0, -found.min()), 0.0)
    measured("dark side, share of 1e5", np.abs(dark - 1e-8).max() / 1e5, 3e-7)
    inside = (slice(20, -20), slice(WIDTH // 2 + 2 * REACH_PX, -20))
    gain = 1.0 if blurred else shown(np.ones_like(picture), False)[inside]
    bright = found[inside] / gain / 1e5
    measured("bright side, relative", np.abs(bright - 1).max(), 1e-5)


shares = st.floats(0, 1)
seeds = st.integers(0, 2**31)


@pytest.mark.slow
@pytest.mark.parametrize("blurred", [False, True], ids=["warp", "defocus"])
def test_rendering_is_linear(blurred, measured):
    """Linearity in radiance (two plates without structure, any share of each, 1e-8 to 1
    times as bright): the frame of the sum is the sum of the frames."""

    @examples(15)
    @given(seeds, seeds, shares, st.floats(-8, 0))
    def linear(one, other, share, exponent):
        scale = np.float32(10**exponent)
        a, b = noise(one) * np.float32(share), noise(other) * np.float32(1 - share)
        both = shown((a + b) * scale, blurred) / scale
        apart = shown(a, blurred) + shown(b, blurred)
        measured("relative", np.abs(both - apart).max() / apart.max(), 5e-6)

    linear()


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (1, 64), (64, 1), (3, 3)])
def test_plates_of_a_pixel(shape: tuple[int, int], measured):
    """Plates of 1, 2, 9 and 64 pixels: a constant stays one, at any depth."""
    picture = np.full((*shape, 3), 0.4, np.float32)
    lens = blurring(shape[1], shape[0])
    for distance in (200.0, FOCUS_MM, math.inf):
        found = render(picture, np.full(shape, distance, np.float32), lens)
        measured("with depth", np.abs(found - picture).max(), 1e-6)
    window = Window.of_size(shape[1], shape[0])
    around = Window(-8, -8, shape[1] + 7, shape[0] + 7)
    plate = np.full((around.height, around.width, 3), 0.4, np.float32)
    bent = replace(bending(), illumination=None)
    found = render(plate, None, bent, data_window=around, display_window=window)
    measured("bent", np.abs(found - picture).max(), 1e-6)


PERIOD_PX = 64


def place_error_px(display: Window, method: Filter) -> float:
    """How far from the exact place a plate of waves is read, along x."""
    lens = replace(bending(), illumination=None, lateral_colour=None)
    source = display.grown(8 + display.width // 30, 8 + display.height // 30)
    columns = np.arange(source.x_min, source.x_max + 1) + 0.5
    wave = 0.5 + 0.4 * np.sin(2 * np.pi * columns / PERIOD_PX)
    plate = np.empty((source.height, source.width, 3), np.float32)
    plate[:] = wave[None, :, None]
    windows = {"data_window": source, "display_window": display}
    found = render(plate, None, lens, **windows, method=method, tolerance=1e-4)
    rows = Window(display.x_min, display.y_max // 2, display.x_max, display.y_max // 2)
    exact = stmap_redistort(lens, display, rows, tolerance_px=1e-5).positions_px()
    seen = found[rows.y_min, :, 1] - 0.5
    away = seen - 0.4 * np.sin(2 * np.pi * exact[0, :, 0] / PERIOD_PX)
    return float(np.abs(away).max() * PERIOD_PX / (2 * np.pi * 0.4))


@pytest.mark.parametrize("method", ["catmull-rom", "keys-6"])
@pytest.mark.parametrize("size", [(16384, 64), (64, 16384)])
def test_a_plate_16k_long(size: tuple[int, int], method: Filter, measured):
    """A plate of 16,384 x 64 pixels, either way: read at its exact place, at its far
    end too."""
    measured("px", place_error_px(Window.of_size(*size), method), 1e-3)


@pytest.mark.slow
def test_a_plate_of_16k_by_8k(measured):
    """A plate of 16,384 x 8192 pixels: read at its exact place."""
    measured("px", place_error_px(Window.of_size(16384, 8192), "keys-6"), 1e-3)


@pytest.mark.parametrize("method", ["cubic", "catmull-rom", "keys-6"])
@pytest.mark.parametrize("moved_px", [-1e-9, 1 - 2**-24, -(2.0**-25), 1e-9])
def test_a_hair_short_of_a_pixel(moved_px: float, method: Filter, measured):
    """A map that moves by a hair less than a whole pixel (1e-9 px): reads that pixel,
    not its neighbour."""
    window = Window.of_size(WIDTH, HEIGHT)
    planes = np.full((2, HEIGHT, WIDTH), moved_px, np.float32)
    planes[:, 0, 0] = 0.3
    picture = noise(0)
    found = warp(picture, window, SourceMap(window, planes), method=method)
    exact = np.roll(picture, -round(moved_px), (0, 1))
    inner = (slice(1, -1), slice(1, -1))
    measured("difference", np.abs(found - exact)[inner].max(), 2e-6)


def test_the_filter_in_32_bits(measured):
    """Warp, float32 against float64: the same sum of samples to a few roundings."""
    rng = np.random.default_rng(0)
    moved = rng.uniform(-2, 2, (2, HEIGHT, WIDTH))
    own = np.indices((HEIGHT, WIDTH), np.int32, sparse=True)

    def read(dtype):
        found = resample(
            jnp.asarray(smooth(), dtype),
            jnp.asarray(moved.astype(np.float32), dtype),
            jnp.asarray(own[1]),
            jnp.asarray(own[0]),
            jnp.full(3, jnp.inf, dtype),
            method="keys-6",
        )
        return np.asarray(found, float)

    off = np.abs(read(np.float32) - read(np.float64))
    measured("inside", off[3:-3, 3:-3].max(), 2e-6)
    measured("in the fade of the border", off.max(), 2e-5)


@pytest.mark.parametrize("depth", [0.0, -5.0, np.nan, -np.inf])
def test_no_depth_in_a_plate(depth: float, measured):
    """Zero, negative or no depth in a plate: sky, NaN the nearest pixel's; handed to
    `render` unread it is refused."""
    samples = np.full((HEIGHT, WIDTH), depth_of(5.0) / 1000, np.float32)
    samples[40:60, 50:90] = depth
    read = perpendicular_mm(samples, DepthMeaning(), 1.0)
    mended = without_nan(read)
    expected = depth_of(5.0) if np.isnan(depth) else np.inf
    assert (mended[40:60, 50:90] == np.float32(expected)).all() or np.allclose(
        mended[40:60, 50:90], expected
    )
    assert np.isfinite(render(smooth(), mended, blurring())).all()
    with pytest.raises(ValueError, match="not positive, or NaN"):
        render(smooth(), samples, blurring())
    constant = np.full((HEIGHT, WIDTH, 3), 0.4, np.float32)
    found = render(constant, mended, blurring())
    measured("a constant", np.abs(found - constant).max(), 1e-5)


@pytest.mark.parametrize("depth_mm", [1e-45, 1e-30, 1e-3])
def test_depth_of_almost_zero(depth_mm: float, measured):
    """Depth of 1e-45 to 1e-3 mm: refused in one line, and not after filling the
    memory."""
    depth = DEPTH.copy()
    depth[50, 70] = depth_mm
    with pytest.raises(LensfitError, match="1000 px is the most") as caught:
        render(smooth(), depth, blurring())
    measured("lines of the refusal", str(caught.value).count("\n") + 1, 1)

"""The warp: exactness, order of convergence, edges, highlights, minification."""

from typing import get_args

import numpy as np
import pytest

from lensfit.coords import Window
from lensfit.rendering.filters import Filter, filter_for, first_tap, tap_weights
from lensfit.rendering.resample import resample
from lensfit.rendering.tiles import TileWarp
from lensfit.rendering.uv import SourceMap
from lensfit.rendering.warp import warp

FILTERS = get_args(Filter)


def displaced(window, dx, dy):
    """A map that reads at own position + (dx, dy), scalars or planes."""
    planes = np.empty((2, window.height, window.width), np.float32)
    planes[0], planes[1] = dx, dy
    return SourceMap(window, planes)


def swirl(window, strength=3.0):
    """A smooth map that is neither radial nor separable."""
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    u, v = x / window.width, y / window.height
    dx = strength * np.sin(3 * u + 2 * v)
    return displaced(window, dx, strength * np.cos(2 * u - 4 * v))


def waves(positions, wavelength_px):
    """A band-limited picture of three different channels, mean one."""
    x, y = positions[..., 0] / wavelength_px, positions[..., 1] / wavelength_px
    planes = [np.sin(6.28 * x), np.cos(6.28 * y), np.sin(4.4 * (x + y))]
    return 1 + 0.3 * np.stack(planes, -1)


@pytest.mark.parametrize("method", FILTERS)
def test_identity_returns_the_bits(method):
    window = Window.of_size(61, 47)
    rng = np.random.default_rng(1)
    pixels = rng.normal(size=(47, 61, 5)).astype(np.float32)
    pixels[3, 4], pixels[20, 30] = np.inf, np.nan
    pixels[10, 10] = -0.0
    result = warp(pixels, window, displaced(window, 0, 0), method=method)
    assert result.tobytes() == pixels.tobytes()


@pytest.mark.parametrize("size", [(1, 1), (5, 3), (200, 7), (3, 90)])
def test_pictures_smaller_than_a_tile_are_warped_as_any(size):
    window = Window.of_size(*size)
    rng = np.random.default_rng(2)
    pixels = rng.normal(size=(size[1], size[0], 4)).astype(np.float32)
    result = warp(pixels, window, displaced(window, 0, 0))
    assert result.tobytes() == pixels.tobytes()


def test_whole_pixel_moves_copy_pixels_and_fill_with_nothing():
    window = Window.of_size(30, 20)
    pixels = np.random.default_rng(2).random((20, 30, 4), np.float32)
    result = warp(pixels, window, displaced(window, 3, -2))
    assert np.array_equal(result[2:, :-3], pixels[:-2, 3:])
    assert not result[:2].any()
    assert not result[:, -3:].any()


ORDERS = {"cubic": 2, "catmull-rom": 3, "keys-6": 4}


@pytest.mark.parametrize(("method", "order"), ORDERS.items())
def test_error_falls_with_the_order_of_the_filter(method, order):
    window = Window.of_size(200, 160)
    source_map = swirl(window)
    wavelengths = np.array([8.0, 16.0, 32.0])
    errors = []
    for wavelength in wavelengths:
        pixels = waves(window.pixel_centres(), wavelength).astype(np.float32)
        exact = waves(source_map.positions_px(), wavelength)
        error = warp(pixels, window, source_map, method=method) - exact
        errors.append(np.sqrt(np.mean(error[8:-8, 8:-8] ** 2)))
    slope = np.polyfit(np.log(wavelengths), np.log(errors), 1)[0]
    assert -slope > order - 0.3
    assert errors[0] < (0.015 if method == "cubic" else 0.012)


def test_the_long_filter_keeps_frequencies_close_to_the_sampling_limit():
    t = np.linspace(0, 0.999, 40)[None]
    weights = [np.asarray(w) for w in tap_weights("sinc-16", t)]
    assert sum(weights) == pytest.approx(np.ones_like(t), abs=1e-12)
    for cycles_per_px, most in ((0.05, 1e-3), (0.2, 1.5e-3), (0.3, 4e-3), (0.4, 0.01)):
        wave = [np.exp(2j * np.pi * cycles_per_px * (k - 7)) for k in range(16)]
        value = sum(w * v for w, v in zip(weights, wave, strict=True))
        assert np.abs(value - np.exp(2j * np.pi * cycles_per_px * t)).max() < most
    on_a_sample = np.array([tap_weights("sinc-16", np.zeros((1, 1)))]).ravel()
    assert (on_a_sample == np.eye(16)[7]).all()


@pytest.mark.parametrize("method", ORDERS)
def test_weights_reproduce_polynomials_below_the_order(method):
    t = np.linspace(0, 0.999, 40)[None]
    weights = [np.asarray(w) for w in tap_weights(method, t)]
    first = 1 - len(weights) // 2
    for degree in range(ORDERS[method]):
        value = sum(w * (first + k) ** degree for k, w in enumerate(weights))
        assert np.abs(value - t**degree).max() < 1e-12


@pytest.mark.parametrize("border", ["black", "clamp"])
def test_a_constant_stays_constant_where_the_picture_is(border):
    window = Window.of_size(90, 70)
    pixels = np.full((70, 90, 2), 0.18, np.float32)
    result = warp(pixels, window, swirl(window), border=border)
    inside = slice(None) if border == "clamp" else slice(4, -4)
    assert np.abs(result[inside, inside] - 0.18).max() < 1e-6 * 0.18


def test_the_edge_fades_over_one_pixel_and_colour_stays_premultiplied():
    window = Window.of_size(20, 10)
    pixels = np.ones((10, 20, 4), np.float32) * [0.5, 0.25, 2.0, 1.0]
    result = warp(
        pixels.astype(np.float32), window, displaced(window, -0.25, 0), alpha_channel=3
    )
    alpha = result[5, :, 3]
    # The square about the first position has a quarter of its width off the plate.
    assert alpha[0] == pytest.approx(0.75)
    assert alpha[1:] == pytest.approx(np.ones(19), abs=1e-6)
    assert np.allclose(result[..., :3], pixels[..., :3] * result[..., 3:], atol=1e-6)


def test_positions_that_do_not_exist_read_as_nothing():
    window = Window.of_size(20, 10)
    source_map = displaced(window, 0.5, 0.5)
    source_map.displacement_px[:, 4, 5] = np.nan
    for border in ("black", "clamp"):
        pixels = np.ones((10, 20, 4), np.float32)
        result = warp(pixels, window, source_map, border=border)
        assert not result[4, 5].any()
        assert np.isfinite(result).all()


@pytest.mark.slow
def test_a_highlight_makes_no_negative_light_and_no_rings():
    window = Window.of_size(24, 24)
    pixels = np.full((24, 24, 3), 0.1, np.float32)
    pixels[12, 12] = 1000
    for method in FILTERS:
        for dx, dy in [(0.5, 0.5), (0.3, -0.2), (0.75, 0.1)]:
            moved = displaced(window, dx, dy)
            result = warp(pixels, window, moved, method=method, border="clamp")
            near = np.zeros((24, 24), bool)
            near[10:14, 10:14] = True
            around = result[~near]
            assert np.abs(around - 0.1).max() < 0.1 * 1e-3
            assert result.min() > 0.0999


def test_the_limit_does_not_touch_ordinary_detail():
    # The peak of a spot (sigma 1 px) between samples: what the filter says, no less.
    window = Window.of_size(31, 31)
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    spot = 1e-3 + np.exp(-((x - 15) ** 2 + (y - 15) ** 2) / 2)
    pixels = spot.astype(np.float32)[..., None]
    moved = displaced(window, 0.5, 0.5)
    peak = warp(pixels, window, moved, method="catmull-rom").max()
    along_one_axis = 2 * (9 * np.exp(-1 / 8) - np.exp(-9 / 8)) / 16
    assert peak == pytest.approx(1e-3 + along_one_axis**2, abs=1e-5)
    assert peak > 1.15 * pixels.max()


def test_negative_values_of_a_wide_gamut_survive():
    window = Window.of_size(40, 30)
    pixels = np.full((30, 40, 3), -0.02, np.float32)
    result = warp(pixels, window, displaced(window, 0.4, 0.3), border="clamp")
    assert result == pytest.approx(-0.02, abs=1e-8)


def test_alpha_never_exceeds_one():
    window = Window.of_size(40, 30)
    pixels = np.zeros((30, 40, 4), np.float32)
    pixels[10:20, 10:30] = 1
    result = warp(pixels, window, swirl(window), alpha_channel=3)
    assert result[..., 3].max() <= 1
    assert result[..., 3].min() >= 0
    assert result[..., 0].max() > 1.01  # colour may overshoot: the filter is sharp


def test_windows_share_one_pixel_space():
    plate = Window(-10, -6, 49, 35)
    output = Window(0, 0, 39, 29)
    pixels = waves(plate.pixel_centres(), 12.0).astype(np.float32)
    result = warp(pixels, plate, displaced(output, 0, 0))
    assert np.array_equal(result, pixels[6:36, 10:50])


def test_channels_move_by_their_own_maps():
    window = Window.of_size(40, 30)
    pixels = np.random.default_rng(4).random((30, 40, 3), np.float32)
    still, moved = displaced(window, 0, 0), displaced(window, 1, 0)
    result = warp(pixels, window, [moved, still, moved])
    assert np.array_equal(result[..., 1], pixels[..., 1])
    assert np.array_equal(result[:, :-1, [0, 2]], pixels[:, 1:, [0, 2]])


def test_minification_fades_detail_instead_of_aliasing():
    # 2.5-fold: a pattern beyond what the output can hold must go to its mean.
    source = Window.of_size(400, 400)
    output = Window.of_size(150, 150)
    x, y = np.moveaxis(output.pixel_centres(), -1, 0)
    shrink = displaced(output, 1.5 * x, 1.5 * y)
    fine = waves(source.pixel_centres(), 2.7).astype(np.float32)
    result = warp(fine, source, shrink)[4:-4, 4:-4, :2]
    assert np.sqrt(np.mean((result - 1) ** 2)) < 0.05  # unfiltered: 0.21
    coarse = waves(source.pixel_centres(), 40.0).astype(np.float32)
    exact = waves(shrink.positions_px(), 40.0)
    error = (warp(coarse, source, shrink) - exact)[4:-4, 4:-4]
    assert np.sqrt(np.mean(error**2)) < 0.006


def test_minification_begins_without_a_step():
    source = Window.of_size(400, 60)
    output = Window.of_size(300, 60)
    pixels = np.random.default_rng(5).random((60, 400, 1), np.float32)
    x, _ = np.moveaxis(output.pixel_centres(), -1, 0)
    results = [
        warp(pixels, source, displaced(output, (s - 1) * x, 0))
        for s in (1.2499, 1.2501, 1.26)
    ]
    assert np.abs(results[1] - results[0])[:, :200].max() < 0.1
    assert np.sqrt(np.mean((results[1] - results[0])[:, :100] ** 2)) < 0.02


def rough(window, channels, brightest):
    """Noise with lights in it, one negative pixel, alpha with hard edges last."""
    rng = np.random.default_rng(8)
    size = window.height, window.width
    pixels = rng.random((*size, channels), np.float32)
    pixels[rng.random(size) > 0.99] *= brightest
    pixels[20, 30] = -0.5
    pixels[..., -1] = rng.random(size) > 0.5
    return pixels


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "border", "brightest"),
    [
        ("cubic", "black", 1000.0),
        ("cubic", "clamp", 1.0),
        ("catmull-rom", "black", 1000.0),
        ("keys-6", "clamp", 1.0),
    ],
)
def test_tiles_and_single_readings_agree(method, border, brightest):
    # Shifts, steep parts, positions on samples, beyond the edge and without a place.
    source, output = Window(-20, -10, 230, 171), Window(-9, 3, 200, 150)
    pixels, source_map = rough(source, 4, brightest), swirl(output, 14.0)
    moved = source_map.displacement_px
    moved[:, 60:70, 100:130] = 2
    moved[0, :, 180:] += 25
    moved[1, 100, 50] = np.nan
    moved[:, :20, :20] -= np.float32(60)
    tiles = TileWarp(pixels, source_map, source, border, method, 3).warped()
    row, column = np.indices((output.height, output.width), np.int32)
    ceiling = np.array([np.inf, np.inf, np.inf, 1], np.float32)
    single = resample(
        pixels, moved, column + 11, row + 13, ceiling, border=border, method=method
    )
    assert np.abs(tiles - np.asarray(single)).max() < 1e-4 * brightest
    assert tiles[..., 3].max() <= 1


def test_few_and_odd_channels_are_read_alike():
    window = Window.of_size(130, 90)
    pixels, source_map = rough(window, 6, 50.0), swirl(window)
    together = warp(pixels, window, source_map, method="cubic")
    for count in (1, 2, 3, 5):
        part = warp(pixels[..., :count], window, source_map, method="cubic")
        assert np.abs(part - together[..., :count]).max() < 1e-4


@pytest.mark.slow
def test_no_number_spreads_no_farther_than_the_filter_reaches():
    window = Window.of_size(160, 120)
    for value in (np.nan, np.inf):
        pixels = np.full((120, 160, 1), 0.5, np.float32)
        pixels[60, 80] = value
        for method in FILTERS:
            result = warp(pixels, window, displaced(window, 0.3, 0.4), method=method)
            rows, columns, _ = np.nonzero(~np.isfinite(result))
            assert len(rows)
            assert max(np.ptp(rows), np.ptp(columns)) < -2 * first_tap(method) + 2
            assert result[40, 40] == pytest.approx(0.5, abs=1e-6)


def test_a_ramp_is_returned_exactly_by_every_filter():
    window = Window.of_size(200, 100)
    x, y = np.moveaxis(window.pixel_centres(), -1, 0)
    ramp = ((x + 2 * y) / 512).astype(np.float32)[..., None]
    source_map = swirl(window)
    at = source_map.positions_px()
    exact = (at[..., 0] + 2 * at[..., 1]) / 512
    for method in FILTERS:
        result = warp(ramp, window, source_map, method=method)[..., 0]
        assert np.abs(result - exact)[9:-9, 9:-9].max() < 2e-6


def test_tolerance_chooses_the_filter():
    assert [filter_for(t) for t in (1e-2, 1e-3, 5e-4, 1e-4)] == [
        "cubic",
        "cubic",
        "catmull-rom",
        "keys-6",
    ]


def test_wrong_shapes_are_refused():
    window = Window.of_size(10, 10)
    pixels = np.zeros((9, 10, 3), np.float32)
    with pytest.raises(ValueError, match="do not fill"):
        warp(pixels, window, displaced(window, 0, 0))
    with pytest.raises(ValueError, match="per channel"):
        warp(np.zeros((10, 10, 3), np.float32), window, [displaced(window, 0, 0)])


def test_agrees_with_an_independent_warp():
    oiio = pytest.importorskip("OpenImageIO")
    window = Window.of_size(160, 120)
    source_map = swirl(window)
    pixels = waves(window.pixel_centres(), 24.0).astype(np.float32)
    uv = np.ascontiguousarray(source_map.uv(window))
    theirs = oiio.ImageBufAlgo.st_warp(
        oiio.ImageBuf(pixels), oiio.ImageBuf(uv), "keys", 0.0, flip_t=True
    ).get_pixels(oiio.FLOAT)
    ours = warp(pixels, window, source_map, method="catmull-rom")
    assert np.abs(ours - theirs)[8:-8, 8:-8].max() < 5e-3


def test_where_two_parts_of_a_map_meet_each_is_read_as_it_is():
    """Such as where another program wrote zeros beside its lens: no mean over all that
    lies between, which nobody sees and which takes forever."""
    window = Window.of_size(320, 96)
    rng = np.random.default_rng(0)
    picture = rng.uniform(0.2, 1, (96, 320, 3)).astype(np.float32)
    dx = np.zeros((96, 320), np.float32)
    dx[:, 200:] = -190.25
    found = warp(picture, window, displaced(window, dx, 0.0), method="catmull-rom")
    moved = warp(picture, window, displaced(window, -190.25, 0.0), method="catmull-rom")
    np.testing.assert_allclose(found[:, :200], picture[:, :200], atol=1e-6)
    np.testing.assert_allclose(found[:, 200:], moved[:, 200:], atol=1e-6)

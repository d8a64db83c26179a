"""A frame through a closed-form lens: colours, light, windows, order."""

import numpy as np
import pytest
from radial_lens import IdentityLens, RadialLens

import lensfit
from lensfit.coords import Window
from lensfit.rendering.frame import crop, render
from lensfit.rendering.render_stages import Switches, illumination_gain, prepare_stages
from lensfit.rendering.uv import PlateGeometry, SourceMap

DISPLAY = Window.of_size(240, 160)


def scene(positions):
    """A smooth scene, a function of undistorted position in pixels; three colours."""
    x, y = positions[..., 0] / 9, positions[..., 1] / 11
    planes = [np.sin(x) * np.cos(y), np.cos(x + y), np.sin(y) + 0.2 * np.cos(2 * x)]
    return 1.5 + 0.5 * np.stack(planes, -1)


def plate(window):
    return scene(window.pixel_centres()).astype(np.float32)


def test_each_colour_shows_the_scene_where_that_colour_lands():
    lens = RadialLens(k=0.06, lateral=2e-3, drop=0.5)
    window = DISPLAY.grown(24, 16)
    picture = render(
        plate(window), None, lens, data_window=window, display_window=DISPLAY
    )
    geometry = PlateGeometry.of(lens, DISPLAY)
    points = DISPLAY.pixel_centres().reshape(-1, 2)
    gain = lens.relative_illumination(geometry.mm(points)).reshape(160, 240)
    for index, channel in enumerate("rgb"):
        seen = scene(geometry.undistorted(lens, channel)(points))[:, index]
        exact = seen.reshape(160, 240) * gain
        assert np.abs(picture[..., index] - exact).max() < 4e-3


def test_lateral_colour_moves_red_and_blue_only():
    with_it, without = RadialLens(k=0.06, lateral=2e-3), RadialLens(k=0.06)
    pixels = plate(DISPLAY)
    coloured, plain = render(pixels, None, with_it), render(pixels, None, without)
    assert np.abs(coloured - plain)[..., 1].max() < 1e-6
    for index in (0, 2):
        assert np.abs(coloured - plain)[20:-20, 20:-20, index].max() > 0.01


def test_lateral_colour_alone_leaves_green_as_it_is():
    lens = RadialLens(k=0.06, lateral=2e-3, drop=0.5)
    switches = Switches(distortion=False, falloff=False)
    picture = render(plate(DISPLAY), None, lens, switches=switches)
    assert np.array_equal(picture[..., 1], plate(DISPLAY)[..., 1])
    # Red is magnified about the centre, so it reads nearer to it.
    geometry = PlateGeometry.of(lens, DISPLAY)
    points = DISPLAY.pixel_centres().reshape(-1, 2)
    landed = geometry.distorted(lens, "g")(points)
    exact = scene(geometry.undistorted(lens, "r")(landed))[:, 0].reshape(160, 240)
    assert np.abs(picture[..., 0] - exact)[3:-3, 3:-3].max() < 4e-3


def test_invisible_lateral_colour_costs_no_map_of_its_own():
    stages = prepare_stages(RadialLens(lateral=1e-5), DISPLAY, DISPLAY)
    assert 0 < stages.lateral_colour_px < 0.01
    assert stages.maps[0] is stages.maps[1] is stages.maps[2]
    finer = prepare_stages(RadialLens(lateral=1e-5), DISPLAY, DISPLAY, tolerance=1e-5)
    assert len({id(m) for m in finer.maps}) == 3


def test_an_ideal_lens_returns_the_bits():
    pixels = np.random.default_rng(6).random((160, 240, 4), np.float32)
    assert render(pixels, None, IdentityLens()).tobytes() == pixels.tobytes()


def test_the_public_name_is_the_renderer():
    lens = RadialLens(k=0.06)
    picture = lensfit.render(plate(DISPLAY), None, lens)
    assert np.array_equal(picture, render(plate(DISPLAY), None, lens))


def test_overscan_changes_nothing_in_the_interior():
    lens = RadialLens(k=0.06, lateral=1e-3, drop=0.3)
    wide = DISPLAY.grown(24, 16)
    with_overscan = render(
        plate(wide), None, lens, data_window=wide, display_window=DISPLAY
    )
    without = render(plate(DISPLAY), None, lens)
    assert with_overscan.shape == without.shape
    assert np.abs(with_overscan - without)[20:-20, 30:-30].max() < 1e-5
    # The corner of a barrel lens looks beyond the plate: only overscan has it.
    assert with_overscan[0, 0].min() > 0.3
    assert not without[0, 0].any()


def test_kept_overscan_holds_the_same_frame():
    lens = RadialLens(k=0.06, lateral=1e-3, drop=0.3)
    wide = DISPLAY.grown(24, 16)
    windows = {"data_window": wide, "display_window": DISPLAY}
    kept = render(plate(wide), None, lens, keep_overscan=True, **windows)
    cropped = render(plate(wide), None, lens, **windows)
    assert kept.shape[:2] == (wide.height, wide.width)
    assert np.abs(crop(kept, wide, DISPLAY) - cropped).max() < 2e-4


def test_fall_off_dims_light_and_not_coverage():
    lens = RadialLens(k=0.0, drop=1.0)
    pixels = np.ones((160, 240, 4), np.float32)
    picture = render(pixels, None, lens)
    assert np.array_equal(picture[..., 3], pixels[..., 3])
    assert picture[80, 120, :3] == pytest.approx(1, abs=1e-4)
    assert picture[0, 0, :3] == pytest.approx(0.5, abs=5e-3)


def test_gain_is_exact_to_its_tolerance_and_ones_stay_exactly_one():
    lens = RadialLens(drop=1.5)
    geometry = PlateGeometry.of(lens, DISPLAY)
    gain = illumination_gain(lens, geometry, DISPLAY, tolerance=1e-5)
    exact = lens.relative_illumination(
        geometry.mm(DISPLAY.pixel_centres().reshape(-1, 2))
    )
    assert np.abs(gain.ravel() - exact).max() <= 1.1e-5
    assert prepare_stages(RadialLens(), DISPLAY, DISPLAY).gains == (None, None, None)


def test_an_external_map_takes_the_place_of_the_distortion():
    lens = RadialLens(k=0.06, lateral=2e-3)
    external = SourceMap(DISPLAY, np.full((2, 160, 240), 0.25, np.float32))
    stages = prepare_stages(lens, DISPLAY, DISPLAY, external=external)
    assert np.array_equal(stages.maps[1].displacement_px, external.displacement_px)
    inner = stages.maps[0].displacement_px - external.displacement_px
    assert 0.1 < np.abs(inner).max() < 1
    with pytest.raises(ValueError, match="does not cover"):
        prepare_stages(lens, DISPLAY, DISPLAY.grown(1, 1), external=external)


def test_depth_that_is_no_distance_is_refused():
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="not positive, or NaN"):
            render(plate(DISPLAY), np.full((160, 240), wrong), IdentityLens())
    with pytest.raises(ValueError, match="depth is"):
        render(plate(DISPLAY), np.ones((160, 24)), IdentityLens())


def test_wrong_plates_are_refused():
    with pytest.raises(ValueError, match="3 or 4"):
        render(np.zeros((160, 240), np.float32), None, IdentityLens())
    with pytest.raises(ValueError, match="not inside"):
        crop(np.zeros((4, 4, 3), np.float32), Window.of_size(4, 4), Window(0, 0, 4, 3))

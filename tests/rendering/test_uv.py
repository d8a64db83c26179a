"""Maps of a closed-form lens: exactness, direction, windows, overscan, no inverse."""

import numpy as np
import pytest
from radial_lens import IdentityLens, RadialLens

from lensfit.coords import Window, uv_from_px
from lensfit.rendering.uv import (
    PlateGeometry,
    SourceMap,
    stmap_redistort,
    stmap_undistort,
)

DISPLAY = Window.of_size(480, 320)


@pytest.mark.parametrize("make", [stmap_redistort, stmap_undistort])
def test_identity_lens_gives_the_identity_exact_to_float32(make):
    window = DISPLAY.grown(48, 32)
    uv = make(IdentityLens(), DISPLAY, window).uv(DISPLAY)
    expected = uv_from_px(window.pixel_centres(), DISPLAY).astype(np.float32)
    assert np.array_equal(uv, expected)


@pytest.mark.parametrize("k", [-0.15, 0.05, 0.4])
@pytest.mark.parametrize("tolerance_px", [1e-2, 1e-3])
def test_redistort_holds_undistorted_positions_within_tolerance(k, tolerance_px):
    lens = RadialLens(k)
    made = stmap_redistort(lens, DISPLAY, tolerance_px=tolerance_px)
    exact = PlateGeometry.of(lens, DISPLAY).undistorted(lens, "g")
    points = DISPLAY.pixel_centres().reshape(-1, 2)
    error = made.positions_px().reshape(-1, 2) - exact(points)
    assert np.abs(error).max() <= tolerance_px


def test_barrel_lens_reads_the_corner_from_inside_the_plate_when_undistorting():
    lens = RadialLens(k=0.05)
    centre = np.array([240.0, 160.0])
    own = np.linalg.norm(DISPLAY.pixel_centres()[0, 0] - centre)
    redistort = stmap_redistort(lens, DISPLAY).positions_px()[0, 0]
    undistort = stmap_undistort(lens, DISPLAY).positions_px()[0, 0]
    assert np.linalg.norm(redistort - centre) > own > np.linalg.norm(undistort - centre)


def test_going_there_and_back_closes_to_a_thousandth_of_a_pixel_over_overscan():
    lens = RadialLens(k=0.08, lateral=1e-3)
    window = DISPLAY.grown(72, 48)
    for channel in "rgb":
        back = stmap_undistort(lens, DISPLAY, window, channel).positions_px()
        exact = PlateGeometry.of(lens, DISPLAY).undistorted(lens, channel)
        closed = exact(back.reshape(-1, 2)).reshape(back.shape)
        assert np.abs(closed - window.pixel_centres()).max() <= 1e-3


def test_overscan_map_agrees_with_the_plain_one_inside():
    lens = RadialLens(k=0.1)
    plain = stmap_redistort(lens, DISPLAY).uv(DISPLAY)
    wide = stmap_redistort(lens, DISPLAY, DISPLAY.grown(40, 30)).uv(DISPLAY)
    assert np.abs(wide[30:-30, 40:-40] - plain).max() < 1e-6


def test_map_does_not_depend_on_where_the_display_window_starts():
    lens = RadialLens(k=0.1)
    moved = Window(100, -50, 579, 269)
    here = stmap_redistort(lens, DISPLAY).uv(DISPLAY)
    there = stmap_redistort(lens, moved).uv(moved)
    assert np.abs(here - there).max() < 1e-6


def test_positions_without_inverse_are_nan_exactly_there():
    lens = RadialLens(k=0.05, valid_radius=0.8)
    made = stmap_redistort(lens, DISPLAY)
    points = DISPLAY.pixel_centres().reshape(-1, 2)
    exact = PlateGeometry.of(lens, DISPLAY).undistorted(lens, "g")(points)
    assert np.array_equal(np.isnan(made.positions_px()).reshape(-1, 2), np.isnan(exact))
    finite = np.isfinite(exact)
    assert finite.any()
    error = (made.positions_px().reshape(-1, 2) - exact)[finite]
    assert np.abs(error).max() < 1e-3


def test_uv_read_back_is_the_same_map_and_an_identity_reads_as_exactly_zero():
    lens = RadialLens(k=0.1)
    window = DISPLAY.grown(20, 20)
    made = stmap_redistort(lens, DISPLAY, window)
    again = SourceMap.from_uv(made.uv(DISPLAY), window, DISPLAY)
    assert np.abs(again.displacement_px - made.displacement_px).max() < 1e-4
    identity = stmap_redistort(IdentityLens(), DISPLAY, window).uv(DISPLAY)
    assert not SourceMap.from_uv(identity, window, DISPLAY).displacement_px.any()


def test_another_plate_aspect_keeps_square_pixels():
    geometry = PlateGeometry.of(RadialLens(), Window.of_size(1920, 1080))
    corner = geometry.mm(np.array([[0.0, 0.0]]))
    assert corner == pytest.approx(np.array([[-18.0, -10.125]]))

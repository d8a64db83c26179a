"""Distortion and lateral colour as they were turned: where chief rays land."""

import numpy as np
import pytest
from adjusted_lenses import CORNER_MM, ideal, measured

POINTS = np.stack(np.meshgrid([-12.0, -5.0, 0.3, 8.0, 12.4], [-9.0, 1.0, 9.3]), -1)
POINTS = POINTS.reshape(-1, 2)
CORNER = np.array([[12.445, 9.33375]])


def moved(lens, channel="g"):
    """By distortion, of an undistorted point."""
    return np.asarray(lens.distorted_from_undistorted(POINTS, channel)) - POINTS


def shifted(lens, channel):
    """Against green, at the same places of the photograph."""
    back = np.asarray(lens.undistorted_from_distorted(POINTS, "g"))
    return np.asarray(lens.distorted_from_undistorted(back, channel)) - POINTS


def test_no_distortion_is_the_ideal_projection():
    np.testing.assert_allclose(moved(measured(distortion_gain=0)), 0, atol=1e-12)


def test_distortion_follows_its_gain():
    """To first order: twice a twentieth is a tenth, and the second order is small."""
    once, twice = (moved(measured(distortion_gain=g)) for g in (0.05, 0.1))
    largest = np.abs(moved(measured())).max()
    np.testing.assert_allclose(twice, 2 * once, atol=1e-3 * largest)
    assert np.abs(once).max() > 0.04 * largest


@pytest.mark.parametrize("knobs", [{"distortion_gain": g} for g in (-10, -2, 3, 10)])
def test_any_gain_keeps_the_inverse(knobs):
    lens = measured(**knobs)
    there = np.asarray(lens.distorted_from_undistorted(POINTS))
    back = np.asarray(lens.undistorted_from_distorted(there))
    np.testing.assert_allclose(back, POINTS, atol=1e-9)


@pytest.mark.parametrize("percent", [-30.0, -5.0, 0.0, 4.0, 40.0])
def test_stated_distortion_is_that_of_the_corner(percent):
    expected = CORNER * (1 + percent / 100)
    landed = ideal(distortion_percent=percent).distorted_from_undistorted(CORNER)
    np.testing.assert_allclose(landed, expected, rtol=1e-9)
    # The measured lens has decentering besides, which stays.
    landed = measured(distortion_percent=percent).distorted_from_undistorted(CORNER)
    np.testing.assert_allclose(landed, expected, rtol=2e-3)


def test_each_colour_has_a_gain_of_its_own():
    base, lens = measured(), measured(lateral_red_gain=0.0)
    np.testing.assert_array_equal(shifted(lens, "r"), shifted(lens, "g"))
    np.testing.assert_array_equal(shifted(lens, "b"), shifted(base, "b"))
    doubled = shifted(measured(lateral_blue_gain=2.0), "b") - shifted(base, "g")
    np.testing.assert_allclose(doubled, 2 * (shifted(base, "b") - shifted(base, "g")))


def test_the_overall_gain_multiplies_both():
    base, lens = measured(), measured(chromatic_gain=-1.5)
    for channel in ("r", "b"):
        was = shifted(base, channel) - shifted(base, "g")
        now = shifted(lens, channel) - shifted(base, "g")
        np.testing.assert_allclose(now, -1.5 * was, atol=1e-15)


def test_stated_lateral_colour_is_the_largest_outwards():
    """Of an ideal lens it grows with the radius; a measured one keeps its course."""
    lens = ideal(lateral_red_um=8.0)
    landed = np.asarray(lens.distorted_from_undistorted(CORNER, "r"))
    np.testing.assert_allclose(np.linalg.norm(landed - CORNER), 8e-3, rtol=1e-9)
    assert np.linalg.norm(landed) > CORNER_MM
    blue = lens.distorted_from_undistorted(CORNER, "b")
    np.testing.assert_allclose(blue, CORNER, rtol=1e-14)
    was = shifted(measured(), "b") - shifted(measured(), "g")
    now = shifted(measured(lateral_blue_um=8.0), "b") - shifted(measured(), "g")
    ratio = np.linalg.norm(now, axis=1) / np.linalg.norm(was, axis=1)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)


def test_an_ideal_lens_has_nothing_to_turn():
    base = ideal()
    for name in ("distortion_gain", "chromatic_gain", "lateral_red_gain"):
        lens = ideal(**{name: 3.0})
        np.testing.assert_array_equal(moved(lens), moved(base))
        assert not lens.has_lateral_colour
        assert lens.blur is None

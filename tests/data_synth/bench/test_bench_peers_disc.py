"""A disc behind a mask: thin-lens limits, the area left, and what is matched."""

import numpy as np
import pytest
from drawn_dots import HALF_DIAGONAL_MM, grid_mm, pictures_of
from scipy.ndimage import gaussian_filter

from data_synth.bench.peers.disc import (
    DiscLens,
    DiscNumbers,
    blur_radius_mm,
    matched_disc,
)

FOCAL_MM = 50.0
SETTINGS = [(n, s, 2000.0) for n in (1.4, 2.8) for s in (1900.0, 2120.0)]


def lens_of(numbers, f_number=1.4, focus_mm=1430.0):
    return DiscLens(numbers, FOCAL_MM, HALF_DIAGONAL_MM, 1.4, f_number, focus_mm)


def test_blur_is_that_of_a_thin_lens():
    assert blur_radius_mm(FOCAL_MM, 1.4, 2000.0, 2000.0) == pytest.approx(0, abs=1e-12)
    wide = blur_radius_mm(FOCAL_MM, 1.4, 1430.0, 2000.0)
    assert wide > 0 > blur_radius_mm(FOCAL_MM, 1.4, 3300.0, 2000.0)
    assert blur_radius_mm(FOCAL_MM, 2.8, 1430.0, 2000.0) == pytest.approx(wide / 2)
    # Focused at infinity: an object u from the lens blurs to f/N times f/u across.
    near = blur_radius_mm(FOCAL_MM, 2.0, np.inf, 1050.0)
    assert near == pytest.approx(-FOCAL_MM / 4 * FOCAL_MM / 1000)
    # The mirror of it: focused u away, the stars blur to f/N times f/(u - f) across.
    image_mm = 1000 * FOCAL_MM / 950
    stars = blur_radius_mm(FOCAL_MM, 2.0, 1000.0 + image_mm, np.inf)
    assert stars == pytest.approx(FOCAL_MM / 4 * FOCAL_MM / 950)


def test_the_mask_leaves_what_two_circles_share():
    shift = 0.9
    lens = lens_of(DiscNumbers(1.0, 0.0, shift))
    corner = HALF_DIAGONAL_MM * np.array([0.6, 0.8])
    drawn = lens.psf(corner, 2000.0, pixel_pitch_mm=0.004, size_px=128)
    assert drawn.sum() == pytest.approx(1, abs=1e-12)
    radius = blur_radius_mm(FOCAL_MM, 1.4, 1430.0, 2000.0) / 0.004
    away = shift * radius
    shared = 2 * radius**2 * np.arccos(shift / 2)
    shared -= away / 2 * np.sqrt(4 * radius**2 - away**2)
    assert 1 / drawn.max() == pytest.approx(shared, rel=5e-3)
    at = np.arange(128) + 0.5 - 64
    centre = np.array([drawn.sum(0) @ at, drawn.sum(1) @ at])
    np.testing.assert_allclose(centre, away / 2 * np.array([0.6, 0.8]), atol=0.05)


def test_the_mask_changes_sides_with_the_focus_and_opens_as_the_iris_closes():
    numbers = DiscNumbers(1.0, 0.0, 0.9)
    right = np.array([HALF_DIAGONAL_MM, 0.0])
    raster = {"pixel_pitch_mm": 0.004, "size_px": 128}
    beyond = lens_of(numbers).psf(right, 2000.0, **raster)
    at = np.arange(128) - 63.5
    before = lens_of(numbers, focus_mm=3300.0).psf(right, 2000.0, **raster)
    assert beyond.sum(0) @ at > 5 > -5 > before.sum(0) @ at
    whole = lens_of(numbers, 2.8).psf((0.0, 0.0), 2000.0, **raster)
    stopped = lens_of(numbers, 2.8).psf(0.5 * right, 2000.0, **raster)
    np.testing.assert_allclose(stopped, whole, atol=1e-9)


def test_in_focus_softness_is_left():
    lens = lens_of(DiscNumbers(1.0, 0.012, 0.0), focus_mm=2000.0)
    drawn = lens.psf((0.0, 0.0), 2000.0, pixel_pitch_mm=0.002, size_px=32)
    assert 1 / drawn.max() == pytest.approx(np.pi * 6**2, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("shift", [0.8, -0.5])
def test_what_was_photographed_is_matched(shift):
    true = DiscNumbers(0.85, 0.012, shift)
    hole_mm2 = np.eye(2) * 1.5e-5

    def light_for(setting):
        def light(place, x, y):
            step = float(x[0, 1] - x[0, 0])
            size = x.shape[1]
            lens = lens_of(true, *setting[:2])
            drawn = lens.psf(place, 2000.0, pixel_pitch_mm=step, size_px=size)
            middle = (x[0].mean() / step, y[:, 0].mean() / step)
            moved = np.fft.fft2(drawn)
            for axis, part in enumerate((-middle[1], -middle[0])):
                waves = np.fft.fftfreq(size).reshape((-1, 1) if axis == 0 else (1, -1))
                moved = moved * np.exp(-2j * np.pi * waves * part)
            return gaussian_filter(np.fft.ifft2(moved).real, np.sqrt(1.5e-5) / step)

        return light

    pictures = [
        pictures_of(light_for(s), s, grid_mm(3, 3), noise=1e-4, hole_mm2=hole_mm2)
        for s in SETTINGS
    ]
    found = matched_disc(pictures)
    assert found.scale == pytest.approx(true.scale, rel=0.02)
    assert found.softness_mm == pytest.approx(true.softness_mm, rel=0.03)
    assert found.shift == pytest.approx(true.shift, abs=0.03)

"""Diameters that nobody stated, of dots drawn on sixteenths of a pixel."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from lensfit.detect.dot_diameter import dot_diameter_mm
from lensfit.detect.dot_images import cut_dot_images
from lensfit.detect.find import observe
from lensfit.photograph import Photograph

FINER, SIZE, PITCH_PX = 8, 400, 40.0
PITCH_MM = (25.0, 20.0)
"""The chart is stretched, and so is its picture."""


def drawn(radius_px: float, blur_px: float, *, dark: bool = True) -> Photograph:
    """A turned grid seen so that what is down looks shorter, its light uneven."""
    middle = (np.arange(SIZE * FINER) + 0.5) / FINER
    x, y = np.meshgrid(middle - SIZE / 2, middle - SIZE / 2)
    turn = np.deg2rad(7.0)
    i = (x * np.cos(turn) + y * np.sin(turn)) / PITCH_PX
    j = (y * np.cos(turn) - x * np.sin(turn)) / (0.8 * PITCH_PX)
    # An ellipse of the chart's circle: mm to the right and down alike.
    off = [(k - np.round(k)) * mm for k, mm in zip((i, j), PITCH_MM, strict=True)]
    inside = np.hypot(*off) < radius_px / PITCH_PX * PITCH_MM[0]
    inside &= np.maximum(np.abs(i), np.abs(j)) < 4.5
    seen = inside.reshape(SIZE, FINER, SIZE, FINER).mean((1, 3))
    seen = gaussian_filter(seen, blur_px)
    paper = 0.7 + 0.1 * np.linspace(0, 1, SIZE)
    light = paper * (0.95 - 0.85 * seen if dark else 0.05 + 0.85 * seen)
    noise = np.random.default_rng(1).normal(0, 0.004, light.shape)
    pixels = (light + noise)[..., None].astype(np.float32)
    return Photograph(pixels, Path("dots.exr"), "")


@pytest.mark.parametrize("dark", [True, False])
@pytest.mark.parametrize("blur_px", [0.7, 2.0])
@pytest.mark.parametrize("radius_px", [7.0, 9.0])
def test_the_diameter_is_found_whatever_the_blur(radius_px, blur_px, dark):
    photograph = drawn(radius_px, blur_px, dark=dark)
    marks = observe(photograph, "dot-grid")
    found = dot_diameter_mm(marks, cut_dot_images(photograph, marks), PITCH_MM)
    true_mm = 2 * radius_px / PITCH_PX * PITCH_MM[0]
    assert found == pytest.approx(true_mm, rel=0.01)


def test_dots_whose_middle_is_blurred_do_not_tell():
    photograph = drawn(5.0, 4.0)
    marks = observe(photograph, "dot-grid")
    assert dot_diameter_mm(marks, cut_dot_images(photograph, marks), PITCH_MM) is None

"""The power of light that samples are, from spots drawn on a pixel grid."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr

from lensfit.detect.dot_images import cut_dot_images
from lensfit.detect.find import observe
from lensfit.fitting.chart_view import View
from lensfit.photograph import Photograph
from lensfit.workflow.statements.encoding import nonlinear_views, power_of_light

SIZE_PX, PITCH_PX, RADIUS_PX, BLUR_PX = (640, 480), 27.37, 0.7, 0.15
HALF_PX, FINE = 6, 8


def photograph(power: float, seed: int = 0) -> Photograph:
    """Soft discs of several sizes on black, integrated over pixels, with noise."""
    rng = np.random.default_rng(seed)
    width, height = SIZE_PX
    light = rng.normal(0, 1e-4, (height, width))
    fine = (np.arange(2 * HALF_PX * FINE) + 0.5) / FINE - HALF_PX
    for x in np.arange(15.2, width - 12, PITCH_PX):
        for y in np.arange(14.7, height - 12, PITCH_PX):
            radius = RADIUS_PX * (1 + 0.01 * rng.normal())
            away = np.hypot(*np.meshgrid(fine - x % 1, fine - y % 1))
            disc = 0.9 * ndtr((radius - away) / BLUR_PX)
            spot = disc.reshape(2 * HALF_PX, FINE, 2 * HALF_PX, FINE).mean((1, 3))
            x0, y0 = int(x) - HALF_PX, int(y) - HALF_PX
            light[y0 : y0 + 2 * HALF_PX, x0 : x0 + 2 * HALF_PX] += spot
    pixels = (np.clip(light, 0, None) ** power).astype(np.float32)[..., None]
    return Photograph(pixels, Path("drawn.tif"), sha256="")


def view(power: float, name: str = "view.png", seed: int = 0) -> View:
    taken = photograph(power, seed)
    seen = observe(taken, "dot-grid")
    return View(
        name=name,
        target="dots",
        observations=seen,
        pitch_mm=(10.0, 10.0),
        mark_diameter_mm=None,
        focal_length_mm=50.0,
        sensor_size_mm=(24.0, 24.0 * SIZE_PX[1] / SIZE_PX[0]),
        f_number=4.0,
        focus_distance_mm=2000.0,
        target_distance_mm=2000.0,
        dot_images=cut_dot_images(taken, seen),
    )


@pytest.mark.parametrize(
    ("power", "least", "most"),
    [(1.0, 0.95, 1.05), (1 / 2.2, 0.4, 0.6), (2.2, 1.4, 2.3)],
)
def test_the_power_is_measured(power, least, most):
    """Of spots that are no wider than a pixel, a power above 1 only in part."""
    found = power_of_light(view(power))
    assert found is not None
    assert least < found.value < most
    assert found.standard_deviation < 0.05


@pytest.mark.parametrize(("power", "probable"), [(1 / 2.2, "srgb"), (2.2, "linear")])
def test_samples_that_are_no_light_contradict_the_encoding(power, probable):
    (found,) = nonlinear_views([view(power)])
    assert found.kind == "encoding"
    assert f'probably "{probable}"' in found.remedy


def test_a_view_developed_otherwise_is_named():
    views = [view(1.0, f"view_{k}.png", k) for k in range(3)]
    assert nonlinear_views(views) == []
    (found,) = nonlinear_views([*views, view(1 / 2.2, "day/coded.png")])
    assert "the encoding of coded is not that of the others" in found.text


def test_wide_dots_show_no_power():
    """Nor do views without images of dots."""
    assert power_of_light(replace(view(1.0), dot_images=None)) is None

"""Where the light of a point lies in the frame of a fitted lens, colour by colour.

The frame is made in two steps, by chief-ray maps and by kernels, and `lens.psf` in one:
its array has green's landing in the middle for every channel. Both must agree on where
the middle of the light is, so that neither step moves a colour twice, or not at all.
"""

from pathlib import Path

import numpy as np
import pytest

import lensfit
from lensfit.coords import Window
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs
from lensfit.rendering.frame import render
from lensfit.rendering.highlights import Highlights, spots
from lensfit.rendering.render_stages import Switches
from lensfit.rendering.uv import PlateGeometry

PRIME = Path(__file__).parents[2] / "presets" / "prime_50" / "preset.json"
WIDTH, HEIGHT, HALF = 240, 180, 24
FOCUS_MM, OBJECT_MM = 2000.0, 5000.0
PLACE_PX = (150, 60)


def lens_of(gain):
    knobs = {"lateral_red_gain": gain, "lateral_blue_gain": gain}
    return lensfit.load_preset(PRIME).at(
        focal_length_mm=50.0,
        f_number=2.0,
        focus_distance_mm=FOCUS_MM,
        knobs=adjusted_knobs(NEUTRAL, knobs),
    )


def middle_of(light, beside):
    """x and y of the mean of a patch, from the middle of it."""
    light = light - beside
    at = np.arange(len(light)) + 0.5 - len(light) / 2
    return np.array([light.sum(0) @ at, light.sum(1) @ at]) / light.sum()


@pytest.mark.slow
@pytest.mark.parametrize("gain", [1.0, 20.0])
@pytest.mark.parametrize("power", [2.0, 300.0])
def test_a_point_is_where_its_kernel_says_in_every_colour(power, gain):
    """A dim patch, which is convolved with its level, and a light of its own."""
    lens, dark = lens_of(gain), 1e-4 if power > 2 else 0.5
    geometry = PlateGeometry.of(lens, Window.of_size(WIDTH, HEIGHT))
    pitch_mm = geometry.area_mm[0] / WIDTH
    picture = np.full((HEIGHT, WIDTH, 3), dark, np.float32)
    x, y = PLACE_PX
    picture[y, x] += power * (0.1 if power <= 2 else 1)
    depth = np.full((HEIGHT, WIDTH), OBJECT_MM, np.float32)
    depth -= np.float32(lens.entrance_pupil_offset_mm)
    lit = render(picture, depth, lens)
    picture[y, x] = dark
    ground = render(picture, depth, lens)
    from_sensor = geometry.mm(np.array([[x + 0.5, y + 0.5]]))
    landed_mm = np.asarray(lens.distorted_from_undistorted(from_sensor))[0]
    landed_px = landed_mm / pitch_mm + np.array([WIDTH, HEIGHT]) / 2
    corner = np.floor(landed_px).astype(int) - HALF
    patch = np.s_[corner[1] : corner[1] + 2 * HALF, corner[0] : corner[0] + 2 * HALF]
    kernels = lens.psfs(
        landed_mm[None], OBJECT_MM, pixel_pitch_mm=pitch_mm, size_px=2 * HALF
    )[0]
    for channel, kernel in enumerate(np.asarray(kernels)):
        found = middle_of(lit[patch][..., channel], ground[patch][..., channel])
        expected = middle_of(kernel, 0) + landed_px - (corner + HALF)
        np.testing.assert_allclose(found, expected, atol=0.1)


def test_a_light_keeps_its_energy_and_its_coverage():
    """An opaque point on nothing, wherever between pixels it lands."""
    lens = lens_of(1.0)
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    rgba[PLACE_PX[1], PLACE_PX[0]] = 40, 40, 40, 1
    depth = np.full((HEIGHT, WIDTH), OBJECT_MM, np.float32)
    found = render(rgba, depth, lens, switches=Switches(falloff=False))
    assert found[..., 1].sum() == pytest.approx(40, rel=0.03)
    assert found[..., 3].sum() == pytest.approx(1, rel=0.1)


def test_all_colours_of_a_light_take_the_kernel_of_one_place():
    """However far apart they landed: else a light turns yellow where a coarse tolerance
    makes kernels of few places."""
    light, mask = np.zeros((40, 60, 3), np.float32), np.zeros((40, 60), np.float32)
    for row, column in ((10, 12), (25, 44)):
        mask[row : row + 3, column : column + 3] = 1
        for colour, shift in enumerate((2, 0, -3)):
            light[row + 1, column + 1 + shift, colour] = 5
    found = list(spots(Highlights(light, 4 * np.ones_like(mask), mask), 0.05))
    assert [spot.colour for spot in found] == [0, 0, 1, 1, 2, 2]
    for colour in range(3):
        places = {(s.x, s.y) for s in found if s.colour == colour}
        assert places == {(13.5, 11.5), (45.5, 26.5)}

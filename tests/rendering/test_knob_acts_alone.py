"""A turned knob changes what it names and nothing else, in frames with depth of field.

Lateral colour of one channel leaves every bit of the others; what blurs leaves where
light lands and how much of it arrives; natural fall-off is a factor on the frame.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from ideal_lens import HEIGHT, WIDTH, depth_of

import lensfit
from lensfit.coords import Window
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.rendering.frame import render
from lensfit.rendering.render_stages import Switches
from lensfit.rendering.uv import PlateGeometry

PRIME = Path(__file__).parents[2] / "presets" / "prime_50" / "preset.json"
FOCUS_MM = 2000.0
RED, GREEN, BLUE = range(3)
INNER = np.s_[20:-20, 20:-20]


def thin(**knobs):
    camera = ThinCamera(50.0, 2.0, 0.35, 36.0, WIDTH, HEIGHT)
    return thin_lens_preset(camera).at(
        focus_distance_mm=350.0, knobs=adjusted_knobs(NEUTRAL, knobs)
    )


@cache
def prime():
    return lensfit.load_preset(PRIME)


def fitted(**knobs):
    return prime().at(
        focal_length_mm=prime().entries[0].focal_length_mm,
        f_number=1.4,
        focus_distance_mm=FOCUS_MM,
        knobs=adjusted_knobs(NEUTRAL, knobs),
    )


@cache
def scene(is_fitted):
    """Coloured surfaces at two distances with a slanted outline, and lights of several
    sizes and colours, on either side of it."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    near = x + 0.4 * y > 0.6 * WIDTH
    waves = 0.3 + 0.2 * np.sin(x / 3)[..., None] * np.cos(y[..., None] / [5, 4, 3])
    picture = waves * np.where(near[..., None], [0.9, 0.3, 0.5], [0.3, 0.8, 0.6])
    for row, column, side, colour in (
        (30, 40, 1, (90, 80, 70)),
        (31, 90, 3, (4, 60, 3)),
        (100, 60, 2, (80, 2, 1)),
        (90, 160, 4, (30, 50, 90)),
        (20, 150, 1, (0, 3, 200)),
    ):
        picture[row : row + side, column : column + side] = colour
    if is_fitted:
        depth = np.where(near, 0.8 * FOCUS_MM, 1.6 * FOCUS_MM)
    else:
        depth = depth_of(np.where(near, 6.0, -7.0))
    return picture.astype(np.float32), depth.astype(np.float32)


@cache
def frame_of(lens_of, blurs=True, **knobs):
    picture, depth = scene(lens_of is fitted)
    switches = Switches(defocus=blurs)
    return render(picture, depth, lens_of(**knobs), switches=switches)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lens_of", "knob", "values"),
    [
        (thin, "lateral_{}_um", (None, 60.0, 500.0)),
        (fitted, "lateral_{}_gain", (1.0, 20.0)),
    ],
)
@pytest.mark.parametrize("colour", ["red", "blue"])
def test_lateral_colour_of_a_channel_moves_that_channel_only(
    lens_of, knob, values, colour
):
    own = {"red": RED, "blue": BLUE}[colour]
    others = [c for c in (RED, GREEN, BLUE) if c != own]
    frames = [frame_of(lens_of, **{knob.format(colour): v}) for v in values]
    for frame in frames[1:]:
        assert np.abs(frame[..., own] - frames[0][..., own]).max() > 0.01
        assert frame[..., others].tobytes() == frames[0][..., others].tobytes()


@pytest.mark.parametrize(
    "knob",
    [
        "axial_colour_gain",
        "field_curvature_gain",
        "astigmatism_sagittal_gain",
        "astigmatism_tangential_gain",
        "coma_gain",
        "spherical_gain",
        "other_aberrations_gain",
        "squeeze",
    ],
)
def test_what_shapes_the_blur_leaves_place_and_brightness(knob):
    plain, turned_up = (frame_of(fitted, False, **k) for k in ({}, {knob: 2.0}))
    assert turned_up.tobytes() == plain.tobytes()


def test_natural_fall_off_is_a_factor_on_the_frame():
    """A stated loss: the pupil of this lens leaves it none to photograph."""
    none, twice = (fitted(natural_vignetting_stops=v) for v in (0.0, 1.0))
    found = [frame_of(fitted, natural_vignetting_stops=v) for v in (0.0, 1.0)]
    window = Window.of_size(WIDTH, HEIGHT)
    geometry = PlateGeometry.of(none, window)
    y, x = np.mgrid[20 : HEIGHT - 20 : 10, 20 : WIDTH - 20 : 10]
    points_mm = geometry.mm(np.stack([x, y], -1).reshape(-1, 2) + 0.5)
    bright, dim = (
        np.asarray(lens.relative_illumination(points_mm)) for lens in (none, twice)
    )
    before, after = (frame[y.ravel(), x.ravel(), GREEN] for frame in found)
    np.testing.assert_allclose(after / before, dim / bright, rtol=1e-3)
    assert (dim / bright).min() < 0.99

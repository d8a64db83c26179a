"""The picture of a turned stop, scaled, is what its rays make."""

import numpy as np
import pytest
from ideal_lens import disc
from test_turned_frame import FRAME, lens_of

from lensfit.render.plate_defocus import Defocus
from lensfit.render.stop_shape import StopShape
from lensfit.render.uv import PlateGeometry

PITCH_MM = 36 / FRAME.width


def bank_of(lens):
    return Defocus(lens, PlateGeometry.of(lens, FRAME), 1e-3).bank


@pytest.mark.parametrize(
    ("knobs", "most"),
    [
        ({"blades": 6, "roundness": 0.2}, 0.012),
        pytest.param({"squeeze": 2.0}, 0.012, marks=pytest.mark.slow),
        pytest.param({"ring_brightness": 3.0}, 0.025, marks=pytest.mark.slow),
    ],
    ids=str,
)
@pytest.mark.parametrize("radius_px", [-9.3, 6.1])
def test_it_is_the_point_spread_function(knobs, most, radius_px):
    lens = lens_of(**knobs)
    bank = bank_of(lens)
    assert bank.is_scaled
    level = bank.levels.between(radius_px)
    found = bank.at(np.array([[100.0, 70.0]]), level, ("g",))[0, 0]
    distance_mm = bank.circle.depth_mm(radius_px) + float(lens.entrance_pupil_offset_mm)
    exact = lens.psf(
        (0, 0),
        distance_mm,
        pixel_pitch_mm=PITCH_MM,
        size_px=len(found),
        tolerance=0.005,
    )
    away = np.linalg.norm(found - np.asarray(exact)) / np.linalg.norm(exact)
    assert away < most


def test_round_blades_are_the_disc():
    shape = StopShape.of(lens_of(blades=8, roundness=1.0).blur)
    for radius_px in (-7.3, 2.2):
        found = shape.kernel(radius_px, 12, 1)
        exact = disc(abs(radius_px), 12)
        assert np.linalg.norm(found - exact) < 5e-3 * np.linalg.norm(exact)
    assert shape.kernel(0.0, 2, 1)[2, 2] == 1


def test_it_turns_by_half_a_turn_through_the_focus():
    shape = StopShape.of(lens_of(blades=5, roundness=0.0).blur)
    beyond, before = (shape.kernel(r, 10, 0) for r in (-7.0, 7.0))
    np.testing.assert_allclose(before, beyond[::-1, ::-1], atol=1e-7)
    assert np.abs(before - beyond).max() > 1e-3


@pytest.mark.parametrize(
    "knobs", [{"cat_eye_percent": 40.0}, {"coma_um": 5.0, "blades": 6}], ids=str
)
def test_what_changes_over_the_frame_is_no_single_shape(knobs):
    assert not bank_of(lens_of(**knobs)).is_scaled

"""A photograph of overlapping blur, whose crossings look like a finer chart."""

from types import SimpleNamespace

import numpy as np
import pytest

from lensfit.detect.observations import POINT
from lensfit.workflow.calibration.overlapping_blur import overlapping_blur_reasons

PIXEL_MM = np.array([0.05, 0.05])
LATTICE = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), -1).reshape(-1, 2)


def take(distance_mm, scale=1.0, turn_deg=0.0, **stated):
    """Marks of a thin lens of 50 mm, `scale` times as far apart as they should be."""
    focus_mm = stated.get("focus_distance_mm", 2000.0)
    principal_mm = 50.0 if focus_mm is None else 50.0 / (1 - 50.0 / focus_mm)
    pitch_px = 40.0 * principal_mm / distance_mm / PIXEL_MM[0] * scale
    turn = np.deg2rad(turn_deg)
    turned = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    marks = SimpleNamespace(
        lattice=LATTICE,
        points_px=300 + pitch_px * LATTICE @ turned,
        family=np.full(len(LATTICE), POINT),
    )
    usual = {
        "observations": marks,
        "pixel_mm": PIXEL_MM,
        "pitch_mm": (40.0, 40.0),
        "target": "grid",
        "focal_length_mm": 50.0,
        "focus_distance_mm": 2000.0,
        "target_distance_mm": distance_mm,
        "mark_diameter_mm": 3.0,
        "squeeze": 1.0,
    }
    return SimpleNamespace(**usual | stated)


GOOD = [
    take(2000.0),
    take(1500.0, 1.04, focus_distance_mm=800.0),
    take(2500.0, 0.97, 25.0, focus_distance_mm=None),
]
CROSSINGS = take(2000.0, 0.5**0.5, 45.0, focus_distance_mm=800.0)


def test_a_lattice_of_crossings_is_found_out():
    found = overlapping_blur_reasons([*GOOD, CROSSINGS])
    assert found[:3] == [None] * 3
    assert "bright crossings were taken for dots" in found[3]


@pytest.mark.parametrize(
    "honest",
    [
        pytest.param(take(1000.0, 0.5), id="half the distance stated"),
        pytest.param(take(2000.0, 1.0, 45.0), id="camera rolled"),
        pytest.param(take(2000.0, 0.75), id="zoom with a far pupil"),
        pytest.param(take(float("inf")), id="distance without end"),
    ],
)
def test_other_photographs_are_not_taken_for_overlaps(honest):
    assert overlapping_blur_reasons([*GOOD, honest]) == [None] * 4


@pytest.mark.parametrize(
    "without_a_say",
    [
        {"target_distance_mm": None},
        {"mark_diameter_mm": None},
        {"target": "another grid"},
        {"focal_length_mm": 35.0},
    ],
)
def test_only_dots_of_the_same_kind_at_stated_distances_have_a_say(without_a_say):
    odd = SimpleNamespace(**vars(CROSSINGS) | without_a_say)
    assert overlapping_blur_reasons([*GOOD, odd]) == [None] * 4


def test_one_other_photograph_is_not_enough():
    assert overlapping_blur_reasons([GOOD[0], None, CROSSINGS]) == [None] * 3

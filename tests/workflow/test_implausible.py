"""A photograph whose marks lie at another scale than the others say is found out."""

from types import SimpleNamespace

import numpy as np
import pytest

from lensfit.detect.observations import POINT
from lensfit.workflow.calibration.implausible import why_implausible

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
        "squeeze": 1.0,
    }
    return SimpleNamespace(**usual | stated)


GOOD = [
    take(2000.0),
    take(1500.0, 1.04, focus_distance_mm=800.0),
    take(2500.0, 0.97, 25.0, focus_distance_mm=None),
]
LENSES_BETWEEN_DISCS = take(2000.0, 0.5**0.5, 45.0, focus_distance_mm=800.0)


def test_a_lattice_of_overlaps_is_found_out():
    found = why_implausible([*GOOD, LENSES_BETWEEN_DISCS])
    assert found[:3] == [None] * 3
    assert "closer than the other photographs" in found[3]
    assert "target_distance_mm" in found[3]


def test_marks_too_far_apart_are_told_so():
    found = why_implausible([*GOOD, take(2000.0, 1.5)])
    assert "47% farther apart" in found[3]


@pytest.mark.parametrize(
    "without_a_say",
    [
        {"target_distance_mm": None},
        {"target": "another grid"},
        {"focal_length_mm": 35.0},
    ],
)
def test_only_stated_distances_of_the_same_kind_have_a_say(without_a_say):
    odd = SimpleNamespace(**vars(LENSES_BETWEEN_DISCS) | without_a_say)
    assert why_implausible([*GOOD, odd]) == [None] * 4


def test_two_photographs_outvote_nobody():
    assert why_implausible([GOOD[0], LENSES_BETWEEN_DISCS]) == [None, None]
    assert why_implausible([GOOD[0], None, LENSES_BETWEEN_DISCS]) == [None] * 3

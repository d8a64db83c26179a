"""Breathing against that of a lens that moves as a whole, near and far swapped."""

from types import SimpleNamespace

import pytest

from lensfit.fitting.breathing import breathing_notes


def state(focus_mm, principal_mm, target_mm=2000.0, focal_mm=50.0):
    take = SimpleNamespace(target_distance_mm=target_mm)
    return SimpleNamespace(
        focal_length_mm=focal_mm,
        focus_distance_mm=focus_mm,
        distortion=SimpleNamespace(principal_distance_mm=principal_mm),
        geometry=SimpleNamespace(takes=(take,)),
    )


NEAR_MM, FAR_MM = 1300.0, 3300.0
EXTENDED, DRAWN_IN = 52.0, 50.8
"""c = f + f^2 / (s - f), of a thin lens."""


def test_a_lens_that_moves_as_a_whole_is_not_remarked_on():
    assert not [*breathing_notes([state(NEAR_MM, EXTENDED), state(FAR_MM, DRAWN_IN)])]


def test_swapped_focus_distances_are_remarked_on():
    (note,) = breathing_notes([state(FAR_MM, EXTENDED), state(NEAR_MM, DRAWN_IN)])
    assert "2.4 % larger focused at 3300 mm than at 1300 mm" in note
    assert "swapped" in note


def test_infinity_is_farther_than_any_distance():
    (note,) = breathing_notes([state(float("inf"), 51.0), state(NEAR_MM, 50.0)])
    assert "focused at inf mm" in note


@pytest.mark.parametrize("unknown", ["focus", "target"])
def test_what_was_not_measured_says_nothing(unknown):
    focus = None if unknown == "focus" else FAR_MM
    target = None if unknown == "target" else 2000.0
    states = [state(focus, EXTENDED, target), state(NEAR_MM, DRAWN_IN)]
    assert not [*breathing_notes(states)]


def test_focal_lengths_are_not_compared_with_each_other():
    states = [state(NEAR_MM, EXTENDED), state(FAR_MM, 90.0, focal_mm=85.0)]
    assert not [*breathing_notes(states)]

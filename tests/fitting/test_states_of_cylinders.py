"""Behind cylinders marks move to chief rays only where that predicts them better."""

from types import SimpleNamespace

import pytest

from lensfit.fitting.lens_state import more_accurate_state


def state(held_out_px: float, squeeze: float, focus_mm: float = 2000.0):
    takes = (SimpleNamespace(anamorphic=squeeze != 1.0),)
    geometry = SimpleNamespace(takes=takes, held_out_rms_px=held_out_px)
    return SimpleNamespace(
        geometry=geometry, focal_length_mm=50.0, focus_distance_mm=focus_mm
    )


@pytest.mark.parametrize("moved_px", [0.02, 0.08])
def test_the_state_that_predicts_its_marks_better_stays(moved_px):
    centroids, moved = state(0.05, 1.9), state(moved_px, 1.9)
    elsewhere = state(0.001, 1.9, 3000.0)
    found = more_accurate_state(moved, [elsewhere, centroids])
    assert found is (moved if moved_px < 0.05 else centroids)


def test_a_lens_without_cylinders_keeps_chief_rays():
    moved = state(0.08, 1.0)
    assert more_accurate_state(moved, [state(0.05, 1.0)]) is moved


def test_a_state_that_was_refused_before_is_taken():
    moved = state(0.08, 1.9)
    assert more_accurate_state(moved, []) is moved

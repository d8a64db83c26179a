"""Which takes belong to one state of the lens, and what is refused.

Behind cylinders detections move to chief rays only where that predicts them better.
"""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from pinhole_shoot import Camera, shoot

from lensfit.errors import FitError
from lensfit.fitting.chart_view import views_by_state
from lensfit.fitting.lens_state import more_accurate_state, states_worse_at_chief_rays
from lensfit.fitting.lens_states import fit

TAKES = shoot(Camera())


def _focused(*distances_mm: float | None):
    return [
        replace(take, focus_distance_mm=distance)
        for take, distance in zip(TAKES, distances_mm, strict=True)
    ]


def test_focus_that_no_barrel_tells_apart_is_one_state():
    states = views_by_state(_focused(2000.0, 900.0, 2001.0))
    assert [[t.name for t in state] for state in states] == [
        ["view 0", "view 2"],
        ["view 1"],
    ]


def test_infinity_is_a_state_of_its_own():
    assert len(views_by_state(_focused(float("inf"), float("inf"), 2000.0))) == 2


def test_focus_stated_for_some_takes_only_is_refused_by_name():
    with pytest.raises(FitError, match="focus distance") as caught:
        fit(_focused(2000.0, None, 2000.0))
    assert "view 1" in str(caught.value)


def test_a_photograph_that_contradicts_itself_costs_no_other():
    away = [900.0 + 40.0 * view + Camera.focal_length_mm for view in range(3)]
    away[1] *= 1.5
    takes = [
        replace(take, target_distance_mm=distance)
        for take, distance in zip(TAKES, away, strict=True)
    ]
    found = fit(takes)
    assert not found.failed
    geometry = found.states[0].geometry
    assert [take.name for take in geometry.takes] == ["view 0", "view 1", "view 2"]
    assert [one.where for one in geometry.statements if one.contradicts] == ["view 1"]
    assert "view 1: target_distance_mm" in found.notes[0]


def cylindrical(held_out_px: float, squeeze: float, focus_mm: float = 2000.0):
    """A state of a lens with cylinders, or without any at a squeeze of one."""
    takes = (SimpleNamespace(anamorphic=squeeze != 1.0),)
    geometry = SimpleNamespace(takes=takes, held_out_rms_px=held_out_px)
    return SimpleNamespace(
        geometry=geometry, focal_length_mm=50.0, focus_distance_mm=focus_mm
    )


@pytest.mark.parametrize("moved_px", [0.02, 0.08])
def test_the_state_that_predicts_its_marks_better_stays(moved_px):
    centroids, moved = cylindrical(0.05, 1.9), cylindrical(moved_px, 1.9)
    elsewhere = cylindrical(0.001, 1.9, 3000.0)
    found = more_accurate_state(moved, [elsewhere, centroids])
    assert found is (moved if moved_px < 0.05 else centroids)


def test_a_lens_without_cylinders_keeps_chief_rays():
    moved = cylindrical(0.08, 1.0)
    assert more_accurate_state(moved, [cylindrical(0.05, 1.0)]) is moved


def test_states_that_chief_rays_make_decisively_worse_are_found():
    before = [cylindrical(0.05, 1.0, mm) for mm in (1000.0, 2000.0)]
    after = [cylindrical(0.08, 1.0, 1000.0), cylindrical(0.06, 1.0, 2000.0)]
    assert states_worse_at_chief_rays(after, before) == (after[0],)
    assert states_worse_at_chief_rays(after, []) == ()


def test_a_state_that_was_refused_before_is_taken():
    moved = cylindrical(0.08, 1.9)
    assert more_accurate_state(moved, []) is moved

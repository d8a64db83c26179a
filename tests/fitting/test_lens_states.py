"""Which takes belong to one state of the lens, and what is refused."""

from dataclasses import replace

import pytest
from pinhole_shoot import Camera, shoot

from lensfit.errors import FitError
from lensfit.fitting.chart_view import grouped
from lensfit.fitting.lens_states import fit

TAKES = shoot(Camera())


def _focused(*distances_mm: float | None):
    return [
        replace(take, focus_distance_mm=distance)
        for take, distance in zip(TAKES, distances_mm, strict=True)
    ]


def test_focus_that_no_barrel_tells_apart_is_one_state():
    states = grouped(_focused(2000.0, 900.0, 2001.0))
    assert [[t.name for t in state] for state in states] == [
        ["view 0", "view 2"],
        ["view 1"],
    ]


def test_infinity_is_a_state_of_its_own():
    assert len(grouped(_focused(float("inf"), float("inf"), 2000.0))) == 2


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

"""The chain of upgrades, tried with the first step and versions still to come."""

import pytest

from lensfit.errors import PresetError
from lensfit.preset.library.change_set import change_set_of_tables
from lensfit.preset.store import CURRENT_VERSION, STEPS, upgrade


def rename_squish(tables: dict) -> dict:
    tables["squeeze"] = tables.pop("squish")
    return tables | {"schema": "lensfit.preset.2"}


def add_axis(tables: dict) -> dict:
    return tables | {"schema": "lensfit.preset.3", "axis_rad": 0.0}


FUTURE = {1: rename_squish, 2: add_axis}


def test_steps_follow_one_another():
    old = {"schema": "lensfit.preset.1", "squish": 1.9}
    new = upgrade(old, "p.json", steps=FUTURE, current_version=3)
    assert new == {"schema": "lensfit.preset.3", "squeeze": 1.9, "axis_rad": 0.0}
    assert old == {"schema": "lensfit.preset.1", "squish": 1.9}


def test_a_present_preset_is_left_alone():
    new = {"schema": "lensfit.preset.3", "squeeze": 2.0}
    assert upgrade(new, "p.json", steps=FUTURE, current_version=3) is new


def test_a_gap_in_the_chain_is_said():
    with pytest.raises(PresetError, match=r"p.json: .*preset.1\", which is no longer"):
        upgrade({"schema": "lensfit.preset.1"}, "p.json", steps={}, current_version=3)


def test_every_step_leads_to_the_next_version():
    assert set(STEPS) == set(range(1, 1 + len(STEPS)))


def test_the_walk_of_the_pupil_became_its_shift():
    walk = {"walk_mm": -3.0, "chart_distance_mm": 900.0, "standard_deviation_mm": 1.0}
    entry = {
        "projection": {"assumed": ["pupil_walk"], "pupil_walk": walk},
        "covariance": {"parameters": ["radial[0]", "pupil_walk_mm[0]"]},
    }
    old = {"schema": "lensfit.preset.1", "entries": [entry]}
    new = upgrade(old, "p.json")
    assert new["schema"] == f"lensfit.preset.{CURRENT_VERSION}"
    (changed,) = new["entries"]
    assert changed["projection"]["assumed"] == ["pupil_shift"]
    assert changed["projection"]["pupil_shift"]["shift_mm"] == -3.0
    assert changed["covariance"]["parameters"] == ["radial[0]", "pupil_shift_mm[0]"]
    assert "pupil_walk" in old["entries"][0]["projection"]


def test_changes_made_to_an_old_preset_name_the_keys_of_this_one():
    change = {
        "key": "entries[focal_length_mm=50].projection.pupil_walk.walk_mm",
        "value": -4.0,
        "before": -3.0,
        "who": "me",
        "when": "2025-01-31T12:00:00+00:00",
        "why": "measured again",
        "unlocked": True,
    }
    tables = {
        "schema": "lensfit.change_set.1",
        "lens": "takumar_50",
        "base": {"level": "here", "version": "v001"},
        "continues": None,
        "changes": [change],
    }
    (found,) = change_set_of_tables(tables, "v002.json").changes
    assert found.key == "entries[focal_length_mm=50].projection.pupil_shift.shift_mm"

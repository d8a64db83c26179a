"""The chain of upgrades, tried with versions that do not exist yet."""

import pytest

from lensfit.errors import PresetError
from lensfit.preset.upgrade import STEPS, upgrade


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

"""Edits: locks, who and when and why, nothing lost when many edit at once."""

import json
import math
import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest
from library_makers import ENTRY, SLUG, SQUEEZE, change, keep, make_show
from preset_makers import make_blur, make_entry, make_preset

from lensfit.errors import PresetError
from lensfit.preset.library.catalogue import history
from lensfit.preset.library.change_set import ChangeSet, lock_of
from lensfit.preset.library.edit import (
    Author,
    RequestedEdit,
    edit_preset,
    requested_edit_of_text,
)
from lensfit.preset.library.key_path import complete_tables, key_of, steps_of
from lensfit.preset.library.layers import find_preset
from lensfit.preset.library.levels import levels_of
from lensfit.preset.library.shelf import read_version, shelves_of

HERE = Path(__file__).parent
AUTHOR = Author("bo", "by the look of it")


def change_set_at(path: Path) -> ChangeSet:
    found = read_version(path)
    assert isinstance(found, ChangeSet)
    return found


@pytest.mark.parametrize(
    ("key", "lock"),
    [
        ("coma_gain", "free"),
        ("knobs.look.bloom_gain", "free"),
        (SQUEEZE, "locked"),
        ("entries[0].lateral_colour", "locked"),
        ("camera.sensor_width_mm", "locked"),
        ("lens.name", "locked"),
        ("entries", "record"),
        ("entries[0]", "record"),
        ("entries[0].focal_length_mm", "record"),
        ("entries[0].fall_off[0].f_number", "record"),
        ("entries[0].quality.rms_px", "record"),
        ("entries[0].covariance", "record"),
        ("entries[0].lateral_colour.covariance", "record"),
        ("entries[0].fall_off[0].covariance.g", "record"),
        ("provenance.created", "record"),
        ("schema", "record"),
    ],
)
def test_what_is_locked(key: str, lock: str):
    assert lock_of(steps_of(key)) == lock


def test_measured_values_refuse_an_edit_unless_unlocked(tmp_path: Path):
    keep(tmp_path)
    with pytest.raises(PresetError, match=r"was measured and is locked.*--unlock"):
        change(tmp_path, SQUEEZE, 2.0)
    assert sorted(p.name for p in (tmp_path / "lenses" / SLUG).glob("v*")) == [
        "v001.json"
    ]
    found = change(tmp_path, SQUEEZE, 2.0, unlock=True)
    assert found.preset.entries[0].distortion.squeeze == 2.0
    assert change_set_at(found.path).changes[0].unlocked


def test_records_stay_true_even_unlocked(tmp_path: Path):
    keep(tmp_path)
    with pytest.raises(PresetError, match="is a record of the measurement"):
        change(tmp_path, "entries[0].quality.rms_px", 0.0, unlock=True)


def test_an_edit_says_who_when_why_and_what_was_there(tmp_path: Path):
    keep(tmp_path)
    change(tmp_path, "coma_gain", 0.5)
    edited = change_set_at(change(tmp_path, "coma_gain", 0.25).path)
    last = edited.changes[-1]
    assert (last.key, last.before, last.value) == (
        "knobs.aberration.coma_gain",
        0.5,
        0.25,
    )
    assert (last.who, last.why, last.unlocked) == ("bo", "by the look of it", False)
    assert datetime.fromisoformat(last.when).utcoffset() is not None
    assert (edited.base.level, edited.base.version) == ("here", "v001")
    assert edited.continues == "v002"


@pytest.mark.parametrize("author", [Author("", "why"), Author("bo", " ")])
def test_an_edit_without_who_or_why_is_refused(tmp_path: Path, author: Author):
    keep(tmp_path)
    with pytest.raises(PresetError, match="says who and why"):
        edit_preset(SLUG, [RequestedEdit("coma_gain", 1.0)], author, library=tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("coma_gian=1", 'unknown key "coma_gian"; did you mean "coma_gain"'),
        ("knobs.aberration.coma_gian=1", 'did you mean "coma_gain"'),
        ("coma_gain=much", "coma_gain: expected a number, got text"),
        ("coma_gain=NaN", "nan is no finite number"),
        ("coma_gain=1e999", "inf is no finite number"),
        ("coma_gain=1000", "coma_gain: expected"),
        ("coma_gain", "is not KEY=VALUE"),
        ("=1", "is no key"),
        ("a b=1", "is no key"),
        (f"{'a.' * 300}a=1", "is no key"),
        ("entries[9].distortion.squeeze=2", "there are 1, from 0"),
        ("entries[x].distortion.squeeze=2", "names no member of a list"),
        ("entries[focal_length_mm=35].distortion.squeeze=2", "is not there; here are"),
        ("entries.distortion=2", "holds no keys"),
        ("lens[0]=2", "is no list here"),
        (f"{ENTRY}.distortion.squeze=2", 'did you mean "squeeze"'),
        (f"{ENTRY}.distortion.squeeze=-2", "squeeze: expected"),
        (f"{ENTRY}.distortion.valid_box[0]=5", "valid_box: is no box"),
        ("coma_gain=" + "[" * 5000, "expected a number"),
        ("coma_gain=" + "[" * 500 + "]" * 500, "nested deeper than 64"),
        ("coma_gain=" + "9" * 400, "64 bits"),
    ],
)
def test_each_mistake_is_one_line_and_makes_no_version(
    tmp_path: Path, text: str, said: str
):
    keep(tmp_path)
    with pytest.raises(PresetError) as told:
        edit_preset(
            SLUG, [requested_edit_of_text(text)], AUTHOR, library=tmp_path, unlock=True
        )
    assert said in str(told.value)
    assert len(str(told.value)) < 600
    assert len(list((tmp_path / "lenses" / SLUG).glob("v*"))) == 1


def test_keys_are_spelled_one_way():
    preset = make_preset(make_entry(blur=make_blur(), focus_distance_mm=math.inf))
    tables = complete_tables(preset)
    for typed, spelled in {
        "entries[0].distortion.squeeze": "distortion.squeeze",
        "entries[focal_length_mm=50.0].distortion.squeeze": "distortion.squeeze",
        "entries[focus_distance_mm=inf].fall_off[1].g": "fall_off[f_number=2.8].g",
        "entries[0].blur.stops[f_number=1.4].radius_ratio": (
            "blur.stops[f_number=1.4].radius_ratio"
        ),
        "entries[0].blur.aberrations[order=1].um": (
            "blur.aberrations[degree=3,order=1,field_degree=1,field_order=1,part=re].um"
        ),
    }.items():
        whole = f"entries[focal_length_mm=50,focus_distance_mm=inf].{spelled}"
        assert key_of(tables, steps_of(typed)) == whole
        assert key_of(tables, steps_of(whole)) == whole


def test_an_infinite_distance_may_be_set(tmp_path: Path):
    keep(tmp_path, make_preset(make_entry(blur=make_blur())))
    key = f"{ENTRY}.blur.reference_distance_mm"
    wish = requested_edit_of_text(f"{key}=inf")
    found = edit_preset(SLUG, [wish], AUTHOR, library=tmp_path, unlock=True)
    again = find_preset(SLUG, tmp_path)
    assert again.preset == found.preset
    blur = again.preset.entries[0].blur
    assert blur is not None
    assert blur.reference_distance_mm == math.inf


def test_a_dropped_key_is_the_outer_levels_again(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    keep(show)
    change(shot, "coma_gain", 0.5)
    change(shot, "bloom_gain", 0.5)
    drop = [RequestedEdit("coma_gain", drop=True)]
    edit_preset(SLUG, drop, AUTHOR, library=shot)
    knobs = find_preset(SLUG, shot).preset.knobs
    assert (knobs.aberration.coma_gain, knobs.look.bloom_gain) == (1.0, 0.5)
    with pytest.raises(PresetError, match=r"is not changed at sq010/sh0020"):
        edit_preset(SLUG, drop, AUTHOR, library=shot)
    change(show, "coma_gain", 0.7)
    assert find_preset(SLUG, shot).preset.knobs.aberration.coma_gain == 0.7


def test_the_same_value_again_is_no_edit(tmp_path: Path):
    keep(tmp_path)
    change(tmp_path, "coma_gain", 0.5)
    with pytest.raises(PresetError, match=r"is 0.5 already"):
        change(tmp_path, "coma_gain", 0.5)


EDITOR = """
import sys
sys.path.insert(0, sys.argv[1])
from pathlib import Path
from library_makers import change
for n in range(6):
    change(Path(sys.argv[2]), "coma_gain", float(sys.argv[3]) + n / 10)
"""


def test_edits_made_at_once_are_all_kept(tmp_path: Path):
    keep(tmp_path, default=True)
    editors = [
        subprocess.Popen(
            [sys.executable, "-c", EDITOR, str(HERE), str(tmp_path), str(n)]
        )
        for n in range(4)
    ]
    assert [editor.wait() for editor in editors] == [0] * 4
    found = find_preset(SLUG, tmp_path)
    assert found.name == f"{SLUG}@v025"
    changes = change_set_at(found.path).changes
    made = sorted(change.value for change in changes)
    assert made == sorted(a + n / 10 for a in range(4) for n in range(6))
    # each saw the one before it
    assert [c.before for c in changes[1:]] == [c.value for c in changes[:-1]]


def test_history_tells_each_thing_once(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    keep(show, note="from the test day")
    change(show, "coma_gain", 0.5)
    change(show, "bloom_gain", 0.25)
    change(shot, SQUEEZE, 2.0, unlock=True)
    events = history(shelves_of(levels_of(shot), SLUG))
    assert [(e.level, e.version, e.in_use) for e in events] == [
        ("project", "v001", False),
        ("project", "v002", False),
        ("project", "v003", True),
        ("sq010/sh0020", "v001", True),
    ]
    assert events[0].what[0].endswith("from 1 photographs: from the test day")
    assert events[2].what == ("knobs.look.bloom_gain: 0 -> 0.25: by the look of it",)
    assert events[3].what == (f"{SQUEEZE}: 1.9 -> 2 (unlocked): by the look of it",)


def test_a_lock_cannot_be_picked_in_the_file(tmp_path: Path):
    keep(tmp_path)
    path = change(tmp_path, SQUEEZE, 2.0, unlock=True).path
    tables = json.loads(path.read_text())
    del tables["changes"][0]["unlocked"]
    path.write_text(json.dumps(tables))
    with pytest.raises(PresetError, match=r"changes\[0\]: .*is locked"):
        find_preset(SLUG, tmp_path)

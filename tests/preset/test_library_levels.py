"""Levels: the nearest wins key by key, and what lies above a project takes no part."""

import shutil
from pathlib import Path

import msgspec
import pytest
from library_makers import ENTRY, SLUG, SQUEEZE, change, keep, make_show
from preset_makers import make_entry, make_preset

from lensfit.errors import PresetError
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs
from lensfit.preset.library.edit import Author, RequestedEdit, edit_preset, mark_default
from lensfit.preset.library.layers import find_preset
from lensfit.preset.library.levels import levels_of
from lensfit.preset.library.shelf import Shelf
from lensfit.preset.store import load_preset, save_preset


def knobs_at(library: Path, name: str = SLUG) -> tuple[float, float]:
    knobs = find_preset(name, library).preset.knobs
    return knobs.aberration.coma_gain, knobs.look.bloom_gain


def test_the_nearest_level_wins_key_by_key(tmp_path: Path):
    show, sequence, shot = make_show(tmp_path)
    keep(show)
    change(show, "coma_gain", 0.9)
    change(show, "bloom_gain", 0.1)
    change(sequence, "coma_gain", 0.5)
    change(sequence, "bloom_gain", 0.2)
    change(shot, "bloom_gain", 0.3)
    assert knobs_at(show) == (0.9, 0.1)
    assert knobs_at(sequence) == (0.5, 0.2)
    assert knobs_at(shot) == (0.5, 0.3)
    found = find_preset(SLUG, shot)
    where = {o.change.key: o.part.level for o in found.overrides}
    assert where == {
        "knobs.aberration.coma_gain": "sq010",
        "knobs.look.bloom_gain": "sq010/sh0020",
    }
    assert [p.level for p in found.parts] == [
        "sq010/sh0020",
        "sq010",
        "project",
        "project",
    ]


def test_everything_else_is_the_outer_preset(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    keep(show)
    change(shot, "coma_gain", 0.5)
    outer, inner = find_preset(SLUG, show).preset, find_preset(SLUG, shot).preset
    assert msgspec.structs.replace(inner, knobs=NEUTRAL) == outer


def test_an_outer_version_saved_later_shows_through_unless_pinned(tmp_path: Path):
    show, sequence, shot = make_show(tmp_path)
    keep(show)
    change(shot, "coma_gain", 0.5)
    author = Author("bo", "approved with v001")
    edit_preset(
        SLUG, [RequestedEdit("coma_gain", 0.5)], author, library=sequence, pin=True
    )
    shutil.rmtree(shot / "lenses")
    change(shot, "bloom_gain", 0.3)
    keep(show, make_preset(make_entry(distortion=wider())))
    loose = find_preset(SLUG, show).preset.entries[0].distortion.squeeze
    pinned = find_preset(SLUG, shot).preset.entries[0].distortion.squeeze
    assert (loose, pinned) == (1.95, 1.9)


def wider():
    return msgspec.structs.replace(make_entry().distortion, squeeze=1.95)


def test_a_value_that_changed_beneath_an_edit_is_told(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    keep(show)
    change(shot, SQUEEZE, 2.0, unlock=True)
    assert find_preset(SLUG, shot).notes == ()
    keep(show, make_preset(make_entry(distortion=wider())))
    found = find_preset(SLUG, shot)
    assert found.preset.entries[0].distortion.squeeze == 2.0
    assert len(found.notes) == 1
    assert "was 1.9 when sq010/sh0020 v001 changed it and is 1.95" in found.notes[0]


def test_an_edit_of_what_is_gone_beneath_is_one_line_and_can_be_dropped(
    tmp_path: Path,
):
    show, _, shot = make_show(tmp_path)
    keep(show)
    change(shot, "coma_gain", 0.5)
    change(shot, SQUEEZE, 2.0, unlock=True)
    keep(show, make_preset(make_entry(focal_length_mm=35.0)))
    with pytest.raises(PresetError, match="which the preset beneath does not have"):
        find_preset(SLUG, shot)
    author = Author("bo", "another lens now")
    wishes = [RequestedEdit(SQUEEZE, drop=True)]
    edit_preset(SLUG, wishes, author, library=shot, unlock=True)
    assert find_preset(SLUG, shot).preset.entries[0].focal_length_mm == 35.0
    assert knobs_at(shot) == (0.5, 0.0)


def test_a_whole_preset_hides_what_lies_further_out(tmp_path: Path):
    show, sequence, shot = make_show(tmp_path)
    keep(show)
    change(show, "coma_gain", 0.9)
    keep(sequence)
    change(shot, "bloom_gain", 0.3)
    assert knobs_at(shot) == (1.0, 0.3)


def test_a_folder_without_a_project_stands_alone(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    keep(show)
    (show / "lenses" / "project.json").unlink()
    assert [level.label for level in levels_of(shot)] == ["library"]
    with pytest.raises(PresetError, match="neither a file nor a lens"):
        find_preset(SLUG, shot)


def test_a_stray_folder_above_the_project_takes_no_part(tmp_path: Path):
    _, _, shot = make_show(tmp_path)
    keep(tmp_path)
    assert [level.label for level in levels_of(shot)] == [
        "sq010/sh0020",
        "sq010",
        "project",
    ]
    with pytest.raises(PresetError, match="neither a file nor a lens"):
        find_preset(SLUG, shot)


def test_a_change_set_without_its_preset_is_one_line(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    keep(show)
    change(shot, "coma_gain", 0.5)
    shutil.rmtree(show / "lenses" / SLUG)
    with pytest.raises(PresetError, match="of an outer level, where there is none"):
        find_preset(SLUG, shot)


def test_versions_by_name(tmp_path: Path):
    for _ in range(3):
        keep(tmp_path)
    for asked in ("", "@latest", "@v003", "@v3", "@3"):
        assert find_preset(f"{SLUG}{asked}", tmp_path).name == f"{SLUG}@v003"
    assert find_preset("SMC Takumar 50/1.4@v001", tmp_path).name == f"{SLUG}@v001"
    with pytest.raises(PresetError, match="has no v007; it holds v001, v002, v003"):
        find_preset(f"{SLUG}@v007", tmp_path)
    with pytest.raises(PresetError, match="has no version marked as default"):
        find_preset(f"{SLUG}@default", tmp_path)


def test_the_default_is_used_until_it_is_edited_and_again_when_marked(tmp_path: Path):
    keep(tmp_path, default=True)
    keep(tmp_path)

    def in_use() -> str:
        return find_preset(SLUG, tmp_path).name.rpartition("@")[2]

    assert in_use() == "v001"
    change(tmp_path, "coma_gain", 0.5)
    assert in_use() == "v003"  # the edit was made to v001
    change(tmp_path, "coma_gain", 0.4)
    assert in_use() == "v004"
    change(tmp_path, "coma_gain", 0.3, name=f"{SLUG}@v002")
    assert in_use() == "v004"  # an edit of another version
    mark_default(Shelf(levels_of(tmp_path)[0], SLUG), 1, "ana")
    assert in_use() == "v001"
    assert find_preset(f"{SLUG}@latest", tmp_path).name.endswith("v005")


def test_paths_into_a_library_bring_their_levels(tmp_path: Path, monkeypatch):
    show, _, shot = make_show(tmp_path)
    keep(show)
    change(shot, "coma_gain", 0.5)
    monkeypatch.chdir(tmp_path)
    for path in (f"lenses/{SLUG}", f"lenses/{SLUG}/v001.json"):
        found = find_preset(Path("show/sq010/sh0020") / path)
        assert found.preset.knobs.aberration.coma_gain == 0.5
    monkeypatch.chdir(shot / "lenses" / SLUG)
    assert find_preset("v001.json").preset.knobs.aberration.coma_gain == 0.5


def test_the_environment_names_the_library(tmp_path: Path, monkeypatch):
    keep(tmp_path)
    monkeypatch.setenv("LENSFIT_LIBRARY", str(tmp_path))
    assert find_preset(SLUG).name == f"{SLUG}@v001"
    monkeypatch.setenv("LENSFIT_LIBRARY", str(tmp_path / "none"))
    with pytest.raises(PresetError, match=r"is no folder.*make the folder"):
        find_preset(SLUG)


def test_what_is_taken_out_is_whole_and_says_where_from(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    keep(show)
    change(shot, SQUEEZE, 2.0, unlock=True)
    found = find_preset(SLUG, shot)
    save_preset(found.taken_out("cy"), tmp_path / "out.json")
    loaded = load_preset(tmp_path / "out.json")
    assert loaded.entries == found.preset.entries
    assert loaded.saved is not None
    assert loaded.saved.origin == f"{SLUG}@v001 (sq010/sh0020 v001 on project v001)"
    assert loaded.saved.edits[0].startswith(f"{ENTRY}.distortion.squeeze = 2 (was 1.9)")


def test_a_version_is_that_of_the_nearest_level_which_has_one(tmp_path: Path):
    show, sequence, shot = make_show(tmp_path)
    for gain in (0.7, 0.8, 0.9):
        knobs = adjusted_knobs(NEUTRAL, {"coma_gain": gain})
        keep(show, msgspec.structs.replace(make_preset(make_entry()), knobs=knobs))
    change(sequence, "bloom_gain", 0.2)
    change(sequence, "bloom_gain", 0.3)
    change(shot, "bloom_gain", 0.4)

    def meant(version: str) -> str:
        return find_preset(f"{SLUG}{version}", shot).full_name.replace(SLUG, "lens")

    assert meant("") == meant("@latest") == "sq010/sh0020:lens@v001"
    assert meant("@v001") == "sq010/sh0020:lens@v001"
    assert meant("@v002") == "sq010:lens@v002"
    assert meant("@v003") == "project:lens@v003"
    assert knobs_at(shot, f"{SLUG}@v002") == (0.9, 0.3)
    assert knobs_at(shot, f"{SLUG}@v003") == (0.9, 0.0)


def test_what_else_has_that_number_is_noted_unless_the_level_is_named(tmp_path: Path):
    show, sequence, shot = make_show(tmp_path)
    keep(show)
    keep(show)
    change(sequence, "coma_gain", 0.5)
    change(shot, "coma_gain", 0.3)
    (note,) = find_preset(f"{SLUG}@v001", shot).notes
    assert note == (
        f"{SLUG}@v001 is that of sq010/sh0020; others of that number are "
        f"sq010:{SLUG}@v001, project:{SLUG}@v001"
    )
    (note,) = find_preset(f"{SLUG}@v002", shot).notes
    assert note.startswith(f"{SLUG}@v002 is that of project, without what sq010/sh0020")
    for label, gain in (("sq010/sh0020", 0.3), ("sq010", 0.5), ("project", 1.0)):
        found = find_preset(f"{label}:{SLUG}@v001", shot)
        assert found.full_name == f"{label}:{SLUG}@v001"
        assert found.preset.knobs.aberration.coma_gain == gain
        assert found.notes == ()
    assert find_preset(f"project:{SLUG}", shot).full_name == f"project:{SLUG}@v002"
    assert find_preset(f"{SLUG}@v001", show).notes == ()


def test_a_level_that_is_named_must_hold_the_lens_and_be_one(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    keep(show)
    with pytest.raises(PresetError, match=f"the nearest is project:{SLUG}"):
        find_preset(f"sq010:{SLUG}@v001", shot)
    with pytest.raises(
        PresetError, match=r"'sq020' is no level here; levels are sq010"
    ):
        find_preset(f"sq020:{SLUG}@v001", shot)
    with pytest.raises(PresetError, match="neither a file nor a lens"):
        find_preset("project:nobody", shot)

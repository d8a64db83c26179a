"""Whatever a file or a name holds: one line, and nothing written elsewhere."""

import copy
import json
import os
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from library_makers import SLUG, SQUEEZE, change, keep, make_show
from preset_makers import make_blur, make_entry, make_preset

from lensfit.errors import LensfitError, PresetError
from lensfit.preset.library.catalogue import catalogue, validation_faults
from lensfit.preset.library.layers import find_preset
from lensfit.preset.library.levels import levels_of, slug_of
from lensfit.preset.library.shelf import read_version
from lensfit.preset.store import load_preset, preset_tables, save_preset

ODD: list[Any] = [
    *(None, True, 0, -1, 3, 10**18, 2**63, 10**400, 50.0, 1e308, -1e308, 5e-324, 1e200),
    *(float("nan"), float("inf"), "", "inf", "NaN", "\ud800", "\0", "a" * 5000, "\n"),
    *(
        "../..",
        "v001",
        "v999999999",
        "lensfit.preset.99",
        "here",
        [],
        {},
        [[]],
        {"a": 1},
    ),
]
STRANGE_KEYS = ["zz", "squeze", "a" * 9999, "\ud800", "a\nb", "`x`"]


def places(value: Any, place: tuple = ()) -> Iterator[tuple]:
    """Where each value of plain tables stands."""
    yield place
    items = value.items() if isinstance(value, dict) else ()
    items = enumerate(value) if isinstance(value, list) else items
    for key, below in items:
        yield from places(below, (*place, key))


def spoiled(tables: dict, rng: random.Random) -> bytes:
    """The file with one to three things wrong, and now and then cut short."""
    tables = copy.deepcopy(tables)
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        *above, last = rng.choice([p for p in places(tables) if p])
        parent = tables
        for key in above:
            parent = parent[key]
        kind = rng.random()
        if kind < 0.7:
            parent[last] = copy.deepcopy(rng.choice(ODD))
        elif kind < 0.8:
            del parent[last]
        elif isinstance(parent, dict):
            parent[rng.choice(STRANGE_KEYS)] = rng.choice(ODD)
        if not tables:
            break
    text = json.dumps(tables, ensure_ascii=rng.random() < 0.5)
    content = text.encode("utf-8", "surrogatepass")
    return content[: rng.randrange(len(content))] if rng.random() < 0.1 else content


def answered(read: Any, *arguments: Any) -> bool:
    """Whether it was accepted; any failure but a short line fails the test."""
    fault = None
    try:
        read(*arguments)
    except LensfitError as said:
        fault = str(said)
    assert fault is None or ("\n" not in fault and len(fault) < 1500)
    return fault is None


def test_spoiled_presets_are_refused_or_kept(tmp_path: Path):
    rng = random.Random(11)
    blur = make_blur()
    tables = preset_tables(make_preset(make_entry(blur=blur)))
    path, again = tmp_path / "p.json", tmp_path / "again.json"
    accepted = 0
    for _ in range(500):
        path.write_bytes(spoiled(tables, rng))
        if answered(load_preset, path):
            accepted += 1
            save_preset(load_preset(path), again)
            assert load_preset(again) == load_preset(path)
    assert 0 < accepted < 250


def test_spoiled_change_sets_are_refused_or_kept(tmp_path: Path):
    rng = random.Random(12)
    keep(tmp_path)
    change(tmp_path, "coma_gain", 0.5)
    last = change(tmp_path, SQUEEZE, 2.0, unlock=True).path
    tables = json.loads(last.read_text())
    accepted = 0
    for _ in range(500):
        last.write_bytes(spoiled(tables, rng))
        accepted += answered(read_version, last)
        answered(find_preset, SLUG, tmp_path)
    assert 0 < accepted < 250


FILES = {
    "nested": b'{"a":' * 100_000,
    "nested and closed": b'{"schema": "lensfit.preset.2", "a":'
    + b"[" * 900
    + b"]" * 900,
    "deep": b'{"schema": "lensfit.preset.2", "a":' + b"[" * 90 + b"]" * 90 + b"}",
    "large": b" " * (33 * 2**20),
    "two": b"{}{}",
    "long number": b'{"schema":' + b"9" * 5000 + b"}",
    "zeros": b"\0" * 100,
    "newer preset": b'{"schema": "lensfit.preset.3"}',
    "newer change set": b'{"schema": "lensfit.change_set.2"}',
    "other": b'{"schema": ["lensfit.preset.2"]}',
}


@pytest.mark.parametrize("name", FILES)
def test_what_is_no_preset_at_all(tmp_path: Path, name: str):
    path = tmp_path / "p.json"
    path.write_bytes(FILES[name])
    for read in (load_preset, read_version, find_preset):
        assert not answered(read, path)


def test_a_newer_schema_names_both_versions(tmp_path: Path):
    path = tmp_path / "p.json"
    path.write_bytes(FILES["newer preset"])
    with pytest.raises(
        PresetError, match=r'preset\.3", newer than "lensfit\.preset\.2"'
    ):
        load_preset(path)
    path.write_bytes(FILES["newer change set"])
    said = r'change_set\.2", newer than "lensfit\.change_set\.1"'
    with pytest.raises(PresetError, match=said):
        find_preset(path)


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/null", "a" * 300, "a\0b", "."])
def test_paths_that_are_no_files(path: str):
    for read in (load_preset, read_version, find_preset):
        assert not answered(read, Path(path))


@pytest.mark.parametrize(
    "name",
    ["", "@", "@v001", "..", "../..", "a/../b", "/", ".", "a@b@c", "\ud800", "é" * 3000]
    + [f"{SLUG}@{v}" for v in ("v0", "v-1", "v٣", "9" * 5000, "../v001", "v001.json")],
)
def test_names_that_are_none(tmp_path: Path, name: str):
    keep(tmp_path)
    assert not answered(find_preset, name, tmp_path)


@pytest.mark.parametrize(
    ("name", "serial", "slug"),
    [
        ("SMC Takumar 50/1.4", "1234567", SLUG),
        ("../../etc/passwd", None, "etc-passwd"),
        ("a\0b\n", "../x", "a-b_x"),
        ("", None, "lens"),
        ("...", None, "ab5df6"),  # of its hash: "***" is another lens
    ],
)
def test_names_of_lenses_become_plain_folders(name: str, serial: str | None, slug: str):
    assert slug_of(name, serial) == slug


def test_names_in_other_letters_stay_apart():
    names = ["ツァイス", "ニコン", "Кинор 35", "Мир 35", "Cooke", "a" * 300, "a" * 301]
    slugs = {slug_of(name) for name in names}
    assert len(slugs) == len(names)
    assert all(len(slug) <= 120 and slug.isascii() for slug in slugs)


links = pytest.mark.skipif(os.name == "nt", reason="symbolic links need rights there")


@links
@pytest.mark.parametrize("where", ["lenses", f"lenses/{SLUG}"])
def test_nothing_is_written_through_a_link_out_of_the_library(
    tmp_path: Path, where: str
):
    outside, library = tmp_path / "outside", tmp_path / "library"
    outside.mkdir()
    (library / where).parent.mkdir(parents=True)
    (library / where).symlink_to(outside)
    with pytest.raises(PresetError, match="symbolic link that leads out"):
        keep(library)
    assert list(outside.iterdir()) == []


@links
def test_nothing_is_read_through_a_link_out_of_the_library(tmp_path: Path):
    library = tmp_path / "library"
    library.mkdir()
    kept = keep(library)
    secret = tmp_path / "secret.json"
    secret.write_text(kept.path.read_text())
    (kept.path.parent / "v002.json").symlink_to(secret)
    with pytest.raises(PresetError, match="symbolic link that leads out"):
        find_preset(SLUG, library)
    assert find_preset(f"{SLUG}@v001", library).name.endswith("v001")
    (kept.path.parent / "v002.json").unlink()
    (kept.path.parent / "v002.json").symlink_to("v001.json")
    assert find_preset(SLUG, library).name.endswith("v002")


@links
def test_a_bad_shelf_does_not_hide_the_others(tmp_path: Path):
    library = tmp_path / "library"
    library.mkdir()
    keep(library)
    (library / "lenses" / "a-bad-one").symlink_to(tmp_path)
    rows = {row.slug: row.fault for row in catalogue(levels_of(library))}
    assert rows[SLUG] is None
    assert "symbolic link" in (rows["a-bad-one"] or "")


def test_validate_names_every_bad_file_of_a_library(tmp_path: Path):
    show, _, shot = make_show(tmp_path)
    kept = keep(show, default=True)
    edited = change(shot, "coma_gain", 0.5).path
    assert set(validation_faults(shot).values()) == {None}
    stranger = kept.path.with_name("v999999999.json")
    stranger.write_text("{}")
    edited.write_text(edited.read_text().replace('"why"', '"wy"'))
    kept.path.with_name("default.json").write_text("[]")
    faults = {
        Path(n).name: f for n, f in validation_faults(shot).items() if f is not None
    }
    assert set(faults) == {"v999999999.json", "default.json", edited.name}
    assert "is no version" in faults["v999999999.json"]
    assert 'did you mean "why"' in faults[edited.name]
    nothing = tmp_path / "empty"
    nothing.mkdir()
    assert "holds no lenses" in str(validation_faults(nothing))


def test_a_change_set_outside_a_library_is_one_line(tmp_path: Path):
    keep(tmp_path)
    text = change(tmp_path, "coma_gain", 0.5).path.read_text()
    path = tmp_path / "changes.json"
    path.write_text(text)
    with pytest.raises(PresetError, match="is a change set outside a library"):
        find_preset(path)
    with pytest.raises(PresetError, match="no lensfit preset"):
        load_preset(path)

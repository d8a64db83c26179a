"""Inspection tells the truth about pictures, and its draft is a valid shoot file."""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import run
from PIL import Image

from lensfit.coords import Window
from lensfit.errors import OutputError
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.mosaic import filled_in
from lensfit.workflow.inspect import as_json, facts, inspect_images
from lensfit.workflow.shoot.draft import draft_shoot, write_draft_shoot
from lensfit.workflow.shoot.shoot_file import load_shoot

OVERSCAN = Window(-4, -3, 43, 32)
FRAME = Window.of_size(40, 30)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    plane = np.full((36, 48), 0.5, np.float32)
    channels = {name: plane for name in ("R", "G", "B", "depth.Z")}
    attributes = {
        "lens/focal": 35.0,
        "lens/fstop": 2.0,
        "lens/focus": float("inf"),
        "lens/aperture": 28.25,
        "lensModel": 'A "quoted" Zoom\\',
    }
    part = ExrPart(channels, OVERSCAN, FRAME, attributes)
    for frame in (1, 2):
        write_exr(tmp_path / f"plate.{frame:04d}.exr", ExrImage((part,)))
    codes = np.full((20, 30, 3), 90, np.uint8)
    codes[:5, :6, 1] = 255
    Image.fromarray(codes).save(tmp_path / "still.png")
    return tmp_path


def test_facts_of_an_exr_sequence(folder: Path):
    inspections, errors = inspect_images([folder / "plate.####.exr"])
    assert errors == []
    assert [i.path.name for i in inspections] == ["plate.0001.exr", "plate.0002.exr"]
    first = inspections[0]
    assert first.size_px == (40, 30)
    assert set(first.channels) == {"R", "G", "B", "depth.Z"}
    assert (first.data_window, first.display_window) == (OVERSCAN, FRAME)
    assert first.clipped_fraction is None
    lines = {what: (value, source) for what, value, source in facts(first)}
    assert lines["focal_length_mm"] == ("35", "lens/focal")
    assert lines["focus_distance_mm"] == ("inf", "lens/focus")
    assert lines["data window"][0] == "(-4, -3) to (43, 32)"
    json.dumps(as_json(first), allow_nan=False)


def test_clipping_is_counted(folder: Path):
    (inspection,), _ = inspect_images([folder / "still.png"])
    assert inspection.clipped_fraction == pytest.approx(30 / 600)
    assert (inspection.encoding, inspection.bit_depth) == ("srgb", 8)


def test_bad_pictures_do_not_stop_the_others(folder: Path):
    (folder / "bad.png").write_bytes(b"nothing")
    images = [folder / "bad.png", folder / "none.exr", folder / "still.png"]
    inspections, errors = inspect_images(images)
    assert [i.path.name for i in inspections] == ["still.png"]
    assert len(errors) == 2


def written(path: Path, *headers: Mapping[str, object]) -> Path:
    plane = np.zeros((30, 40), np.float32)
    parts = [
        ExrPart({"Y" if not i else "mask": plane}, FRAME, FRAME, header, name=f"p{i}")
        for i, header in enumerate(headers)
    ]
    write_exr(path, ExrImage(tuple(parts)))
    return path


def test_a_bad_entry_hides_nothing_else(folder: Path):
    header = {"aperture": -1.0, "lens/focal": 35.0, "lens/fstop": 4.0, "lens/focus": 2}
    bad = written(folder / "bad.exr", header)
    (inspection,), errors = inspect_images([bad])
    assert errors == []
    (problem,) = inspection.camera.problems
    for part in ("'aperture'", "'-1.0'", "--f-number"):
        assert part in problem
    rows = facts(inspection)
    assert ("problem", problem, "") in rows
    assert ("focal_length_mm", "35", "lens/focal") in rows
    assert ("focus_distance_mm", "2000", "lens/focus") in rows
    # Which of the two was meant nobody knows: apply refuses it as well.
    where = rows.index(("f_number", "unknown", "see problem"))
    assert rows[where + 1] == ("", "4", "overruled: lens/fstop")
    json.dumps(as_json(inspection), allow_nan=False)
    result = run("inspect", bad)
    assert result.exit_code == 1
    assert "lens/focal" in result.stdout
    assert result.stderr.splitlines() == [f"lensfit: error: {bad}: {problem}"]


def test_a_bad_entry_that_is_overruled_is_shown_and_no_failure(folder: Path):
    plate = written(folder / "p.exr", {"aperture": 2.0, "lens/fstop": "wide"})
    (inspection,), _ = inspect_images([plate])
    assert inspection.camera.problems == ()
    rows = facts(inspection)
    where = rows.index(("f_number", "2", "aperture"))
    assert rows[where + 1][2] == "passed over"
    assert "'lens/fstop' is 'wide'" in rows[where + 1][1]
    assert run("inspect", plate).exit_code == 0


def test_entries_of_one_header_that_contradict_each_other_are_shown(folder: Path):
    header = {"nominalFocalLength": 40.0, "lens/focal": 28.0}
    plate = written(folder / "p.exr", header)
    result = run("inspect", plate, "--json")
    (record,) = json.loads(result.stdout)
    assert record["state"]["focal_length_mm"] == 40
    (other,) = record["overruled"]["focal_length_mm"]
    assert other == {"value": 28.0, "source": "lens/focal"}
    (line,) = result.stderr.splitlines()
    for part in ("p.exr", "nominalFocalLength (40 mm)", "lens/focal (28 mm)"):
        assert part in line


def test_entries_of_every_part_count_as_in_apply(folder: Path):
    plate = written(folder / "p.exr", {"lens/focal": 35.0}, {"lens/fstop": 4.0})
    (inspection,), _ = inspect_images([plate])
    assert inspection.state.f_number == 4


def test_draft_is_a_valid_shoot_with_what_is_known(folder: Path):
    images = [folder / "plate.0001.exr", folder / "still.png"]
    inspections, _ = inspect_images(images)
    path = folder / "drafts" / "shoot.toml"
    write_draft_shoot(path, inspections)
    shoot = load_shoot(path)
    assert shoot.lens.name == 'A "quoted" Zoom\\'
    assert shoot.camera.sensor_width_mm == 28.25
    plate, still = shoot.takes
    assert shoot.image_path(plate).resolve() == images[0].resolve()
    assert (plate.focal_length_mm, plate.focus_distance_mm) == (35.0, float("inf"))
    assert (still.focal_length_mm, still.encoding) == (None, "srgb")
    text = path.read_text()
    assert "focal_length_mm = 35.0  # from lens/focal" in text
    assert text.count("TODO") >= 5


def test_a_mosaic_shows_in_the_facts_and_in_the_draft(tmp_path: Path):
    rng = np.random.default_rng(0)
    for name in "abc":
        pixels = 0.4 + rng.normal(0, 0.01, (128, 192, 3))
        if name != "c":
            pixels = filled_in(pixels, "gbrg")
        codes = np.rint(pixels * 65535).astype(np.uint16)
        assert cv2.imwrite(str(tmp_path / f"{name}.png"), codes[..., ::-1])
    found, _ = inspect_images(tmp_path / f"{name}.png" for name in "abc")
    assert [one.mosaic for one in found] == ["gbrg", "gbrg", None]
    assert ("mosaic", "gbrg", "its noise") in facts(found[0])
    text = draft_shoot(found[:2], tmp_path)
    assert tomllib.loads(text)["camera"]["mosaic"] == "gbrg"
    mixed = draft_shoot(found, tmp_path)
    assert "mosaic" not in tomllib.loads(mixed)["camera"]
    assert '# "gbrg" from the noise of' in mixed
    assert '# mosaic = "rggb"' in draft_shoot(found[2:], tmp_path)


def test_draft_says_where_photographs_differ(folder: Path):
    plane = np.zeros((30, 40), np.float32)
    part = ExrPart({"Y": plane}, FRAME, FRAME, {"lens/aperture": 36.0})
    write_exr(folder / "other.exr", ExrImage((part,)))
    images = [folder / "plate.0001.exr", folder / "other.exr"]
    write_draft_shoot(folder / "shoot.toml", inspect_images(images)[0])
    text = (folder / "shoot.toml").read_text()
    assert tomllib.loads(text)["camera"]["sensor_width_mm"] == 28.25
    assert "# TODO: but 36.0 from lens/aperture of other.exr" in text


def test_draft_never_replaces_a_file(folder: Path):
    (folder / "shoot.toml").write_text("mine")
    inspections, _ = inspect_images([folder / "still.png"])
    with pytest.raises(OutputError, match="edited"):
        write_draft_shoot(folder / "shoot.toml", inspections)
    assert (folder / "shoot.toml").read_text() == "mine"


def test_command_prints_tables_and_drafts(folder: Path):
    draft = folder / "shoot.toml"
    arguments = ["inspect", str(folder / "still.png"), "--write-shoot", str(draft)]
    result = run(*arguments)
    assert result.exit_code == 0
    assert "30 x 20 px" in result.stdout
    assert "5.00%" in result.stdout
    assert load_shoot(draft).takes[0].image == "still.png"


@pytest.mark.parametrize(
    ("image", "columns"), [("still.png", 2), ("plate.0001.exr", 3)]
)
def test_a_table_has_no_column_without_a_word(folder: Path, image: str, columns: int):
    result = run("inspect", folder / image)
    (line,) = (one for one in result.stdout.splitlines() if " size " in one)
    assert line.count("│") == columns + 1


def test_command_json_and_errors(folder: Path):
    (folder / "empty.exr").touch()
    images = [str(folder / "empty.exr"), str(folder / "plate.0001.exr")]
    result = run("inspect", "--json", *images)
    assert result.exit_code == 1
    (record,) = json.loads(result.stdout)
    assert record["state"]["focus_distance_mm"] == "inf"
    assert record["state"]["sources"]["f_number"] == "lens/fstop"
    assert result.stderr.splitlines() == [
        f"lensfit: error: {folder / 'empty.exr'}: is empty; copy it again"
    ]

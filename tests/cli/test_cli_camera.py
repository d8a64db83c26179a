"""The camera on the command line: every option arrives, slips are told in one line."""

import json
from types import SimpleNamespace

import camera_files as files
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from lensfit.cli.groups.library import LibraryGroup
from lensfit.cli.main import app
from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.plate.camera.sources import CameraOptions
from lensfit.workflow import apply as workflow


@pytest.fixture
def asked(monkeypatch):
    """The options that the command asks the workflow for, which is not run."""
    calls = {}

    def note(preset, plates, out, **options):
        calls.update(options)
        return workflow.Applied()

    monkeypatch.setattr(workflow, "apply", note)
    monkeypatch.setattr(
        LibraryGroup, "find", lambda group, name: SimpleNamespace(preset=None)
    )
    return calls


@pytest.fixture
def plate(tmp_path):
    plane = np.zeros((30, 40), np.float32)
    window = Window.of_size(40, 30)
    part = ExrPart({"Y": plane}, window, window, {"lens/focal": 50.0})
    write_exr(tmp_path / "p.1001.exr", ExrImage((part,)))
    return tmp_path / "p.1001.exr"


def run(*arguments):
    return CliRunner().invoke(app, [*map(str, arguments)])


def applied(tmp_path, *arguments):
    (tmp_path / "p.json").touch()
    return run("apply", tmp_path / "p.json", "a.#.exr", "--out", "o", *arguments)


def test_every_option_reaches_the_workflow(asked, tmp_path):
    first, second = files.arri(tmp_path), files.nuke(tmp_path, "focal 35")
    result = applied(
        tmp_path,
        *("--metadata", first, "--camera", second, "--metadata-start", 1001),
        *("--camera-name", "Camera1", "--camera-unit", "cm"),
        *("--settings", "s.toml", "--focus-at", "1,2,30,40.5"),
    )
    assert result.exit_code == 0, result.stderr
    camera = asked["options"].camera
    assert [str(path) for path in camera.files] == [str(first), str(second)]
    assert (camera.first_frame, camera.camera_name, camera.unit) == (
        1001,
        "Camera1",
        "cm",
    )
    assert str(camera.settings) == "s.toml"
    assert camera.focus_at == (1.0, 2.0, 30.0, 40.5)


def test_the_order_in_which_files_are_given_is_kept(asked, tmp_path):
    a, b, c = files.chan(tmp_path, f1=30.0), files.sony(tmp_path), files.arri(tmp_path)
    applied(tmp_path, "--camera", a, "--metadata", b, "--camera", c)
    assert [p.name for p in asked["options"].camera.files] == [a.name, b.name, c.name]


def test_nothing_is_asked_for_by_default(asked, tmp_path):
    assert applied(tmp_path).exit_code == 0
    assert asked["options"].camera == CameraOptions()


@pytest.mark.parametrize(
    "arguments",
    [
        ["--focus-at", "1"],
        ["--focus-at", "1,2,3"],
        ["--focus-at", "a,b"],
        ["--focus-at", "nan,1"],
        ["--focus-at", "1,1", "--focus-distance-mm", "5"],
        ["--camera-unit", "ell"],
        ["--metadata-start", "first"],
    ],
)
def test_wrong_words_are_wrong_usage(asked, tmp_path, arguments):
    assert applied(tmp_path, *arguments).exit_code == 2


@pytest.mark.parametrize("command", ["apply", "plan", "inspect"])
def test_help_lists_the_options(command):
    text = CliRunner().invoke(app, [command, "--help"], terminal_width=300).stdout
    for option in ("--metadata", "--camera", "--metadata-start", "--settings"):
        assert option in text
    assert ("--focus-at" in text) == (command != "inspect")


def test_inspect_says_where_values_come_from(plate, tmp_path):
    arri = files.arri(tmp_path)
    result = run("inspect", "--json", plate, "--metadata", arri, "--f-number", 4)
    assert result.exit_code == 0
    (record,) = json.loads(result.stdout)
    assert record["state"]["focal_length_mm"] == 40
    assert "Lens Focal Length" in record["state"]["sources"]["focal_length_mm"]
    assert record["overruled"]["focal_length_mm"][0]["source"] == "lens/focal"
    assert record["state"]["sources"]["f_number"] == "--f-number"


def test_a_narrow_terminal_cuts_no_source(plate, tmp_path, monkeypatch):
    deep = tmp_path / "a_project_with_a_long_name" / "a_sequence_with_a_long_name"
    deep.mkdir(parents=True)
    (deep / "lensfit.toml").write_text("[camera]\nf_number = 2.8\n")
    plate = plate.rename(deep / "p.1001.exr")
    monkeypatch.setattr("lensfit.cli.inspect.console", lambda: Console(width=80))
    said = run("inspect", plate).stdout
    assert "…" not in said
    cells = (line.split("│")[3].strip() for line in said.splitlines() if "│" in line)
    assert f"{deep / 'lensfit.toml'} [camera]".replace(" ", "") in "".join(
        cells
    ).replace(" ", "")


def test_a_broken_sidecar_is_one_line(plate, tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_bytes(b"FrameNo,Focus Distance\n1,near\n")
    result = run("inspect", plate, "--metadata", bad)
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"lensfit: error: {bad}: line 2: Focus Distance")


def test_a_slip_in_the_settings_is_one_line(plate, tmp_path):
    (tmp_path / "lensfit.toml").write_text("[camera]\nfnumber = 2\n")
    result = run("inspect", plate)
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert 'unknown key "fnumber"; did you mean "f_number"?' in line

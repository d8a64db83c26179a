"""`lensfit plan`: stages, reasons and prices, for people and for machines."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr


@pytest.fixture
def plate(tmp_path: Path) -> list[str]:
    """An ideal lens focused at 4 m, and a plate with a step in depth."""
    camera = {
        "focal_length_mm": 35.0,
        "f_number": 1.4,
        "focus_distance_m": 4.0,
        "sensor_width_mm": 28.25,
        "width_px": 96,
        "height_px": 54,
    }
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    preset = str(tmp_path / "thin.json")
    asked = ["preset", "thin-lens", str(tmp_path / "camera.json"), "--out", preset]
    assert run(*asked).exit_code == 0
    depth = np.full((54, 96), 4.0, np.float32)
    depth[:, 50:] = 0.8
    grey = np.full((54, 96), 0.3, np.float32)
    window = Window.of_size(96, 54)
    channels = {"R": grey, "G": grey, "B": grey, "Z": depth}
    header = {"lens/focal": "35.0", "lens/focus": "4.0", "lens/fstop": "1.4"}
    path = tmp_path / "plate.0001.exr"
    write_exr(path, ExrImage((ExrPart(channels, window, window, header),)))
    return [preset, str(path)]


def test_a_plan_names_every_stage_and_why(plate: list[str]):
    found = run("plan", *plate)
    assert found.exit_code == 0, found.output
    for word in ("distortion", "left out", "depth of field", "run", "surfaces"):
        assert word in found.stdout


def test_a_plan_for_machines(plate: list[str]):
    found = run("plan", *plate, "--tolerance", "3e-3", "--json")
    plan = json.loads(found.stdout)
    runs = {stage["stage"]: stage["runs"] for stage in plan["stages"]}
    assert runs == {
        "distortion": False,
        "lateral colour": False,
        "outlines": True,
        "depth of field": True,
        "fall-off": False,
    }
    assert plan["tolerance"] == 3e-3
    assert 0 < plan["expected_error"] < 1e-2
    assert plan["expected_seconds"] > 0


def test_a_plate_that_is_none_is_refused(plate: list[str], tmp_path: Path):
    wrong = tmp_path / "none.exr"
    wrong.write_bytes(b"no picture")
    found = run("plan", plate[0], wrong)
    assert found.exit_code == 1


def test_of_a_sequence_the_first_frame_is_planned(plate: list[str]):
    pattern = plate[1].replace("0001", "####")
    found = run("plan", plate[0], pattern, "--json")
    notes = json.loads(found.stdout)["notes"]
    assert "the plan is that of the first frame, plate.0001.exr" in notes
    lacking = run("plan", plate[0], pattern.replace("plate.", "no."))
    assert lacking.exit_code == 1
    assert "no frame exists" in lacking.stderr


@pytest.mark.parametrize("command", ["plan", "apply"])
def test_a_knob_of_what_is_left_out_is_told(plate: list[str], command: str):
    out = ["--out", str(Path(plate[1]).parent / "out")] if command == "apply" else []
    left_out = ["--no-distortion", "--no-falloff", "--no-defocus"]
    knobs = ["--distortion-percent", "2", "--disable", "vignetting"]
    found = run(command, *plate, *out, *left_out, *knobs)
    assert found.exit_code == 0, found.output
    assert found.stderr.count("leaves its effect out") == 1
    said = "--distortion-percent has no effect: --no-distortion leaves"
    assert said in found.stderr

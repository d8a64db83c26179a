"""Rows and bars of the benchmark of verdicts; what calibrates is stood for."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from data_synth.bench.verdict import benchmark
from data_synth.bench.verdict.benchmark import bench_verdict, level_of_errors
from data_synth.bench.verdict.wrong_shoots import WRONG_SHOOTS, WrongShoot
from data_synth.bench.wavefront.benchmark import Trial
from data_synth.judge_depths import FrameErrors
from lensfit.errors import DetectionError

SHOOT = """
[lens]
name = "L"
[camera]
sensor_width_mm = 28.0
sensor_height_mm = 21.0
[[target]]
name = "dots"
kind = "dot-grid"
pitch_mm = 53.0
hole_diameter_mm = 2.0
[[target]]
name = "lines"
kind = "line-grid"
pitch_mm = 80.0
line_width_mm = 4.9
"""
TAKE = """
[[take]]
image = "{name}.png"
target = "{target}"
focal_length_mm = 28.0
f_number = {stop}
focus_distance_mm = {focus}
target_distance_mm = 1120.0
encoding = "linear"
"""


def write_shoot(folder: Path) -> None:
    """Six views of dots, one of lines; grey pictures."""
    folder.mkdir(parents=True)
    text = SHOOT
    for stop in (2.8, 5.6):
        for state, focus in (("in", 1120.0), ("near", 801.0), ("far", 1850.0)):
            name = f"dots_{stop:g}_{state}"
            text += TAKE.format(name=name, target="dots", stop=stop, focus=focus)
    text += TAKE.format(name="dots_tilt", target="dots", stop=2.8, focus=1120.0)
    text += TAKE.format(name="lines", target="lines", stop=8.0, focus=1120.0)
    (folder / "shoot.toml").write_text(text)
    for name in {line.split('"')[1] for line in text.splitlines() if "image" in line}:
        pixels = np.full((48, 64), 20000, np.uint16)
        Image.fromarray(pixels).save(folder / name)


@pytest.mark.parametrize("case", WRONG_SHOOTS, ids=lambda case: case.kind)
def test_every_case_changes_its_copy_and_nothing_else(tmp_path: Path, case):
    right = tmp_path / "right"
    write_shoot(right)
    before = {path.name: path.read_bytes() for path in right.iterdir()}
    shoot = WrongShoot.copy_of(right, tmp_path / "wrong")
    case.spoil(shoot)
    shoot.save()
    after = {path.name: path.read_bytes() for path in shoot.folder.iterdir()}
    assert after != before
    assert "hole_diameter_mm" not in shoot.text
    assert {path.name: path.read_bytes() for path in right.iterdir()} == before


def test_levels_by_the_trace_are_those_of_the_verdict():
    errors = (0.05, 0.3, 1.2, 4.0)
    levels = ["measurement", "match-moving", "look", "unusable"]
    assert [level_of_errors(FrameErrors(one, 0.1)) for one in errors] == levels
    levels = ["undistortion", "undistortion", "look", "unusable"]
    assert [level_of_errors(FrameErrors(one, 0.9)) for one in errors] == levels


def test_what_is_called_worse_or_refused_is_counted(tmp_path: Path, monkeypatch):
    """Of three right shoots one is refused, and one is called worse than it is."""
    said = {"good": "measurement", "timid": "look"}

    def calibrate(shoot, out, **_):
        name = shoot.path.parent.name
        if name == "refused":
            raise DetectionError("no dots found")
        reason = {"tone": "good"}
        return {"verdict": {"level": said[name], "headline": name, "reasons": [reason]}}

    monkeypatch.setattr(benchmark, "calibrate", calibrate)
    monkeypatch.setattr(benchmark, "load_preset", lambda path: path)
    trials = [Trial(name, "", write_shoot) for name in (*said, "refused")]
    result = bench_verdict(trials, None, lambda *_: FrameErrors(0.05, 0.1), tmp_path)
    levels = [(row["level"], row["worse"]) for row in result["right"]]
    assert levels == [("measurement", False), ("look", True), ("refused", False)]
    values = {row["what"]: (row["value"], row["passed"]) for row in result["rows"]}
    assert values == {
        "of 3: refused or called unusable": (1.0, False),
        "of 3: called worse than the trace says": (1.0, False),
    }
    assert json.loads((tmp_path / "bench_verdict.json").read_text()) == result


def test_a_wrong_shoot_that_ends_green_fails(tmp_path: Path, monkeypatch):
    def calibrate(shoot, out, **_):
        reasons = [{"tone": "good"}]
        return {"verdict": {"level": "measurement", "headline": "", "reasons": reasons}}

    monkeypatch.setattr(benchmark, "calibrate", calibrate)
    result = bench_verdict(
        [], Trial("s", "", write_shoot), lambda *_: FrameErrors(0.0, 0.0), tmp_path
    )
    green, named = result["rows"]
    assert (green["passed"], named["passed"]) == (False, False)
    # What the shoot file itself forbids is refused before anything is calibrated.
    refused = [row["kind"] for row in result["wrong"] if row["level"] == "refused"]
    assert green["value"] == len(WRONG_SHOOTS) - len(refused)
    assert "pitch in inches" in refused

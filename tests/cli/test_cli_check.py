"""`lensfit check` from the outside: lines, JSON, pictures, watching, exit codes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bundled_shoot import DEMO
from PIL import Image
from typer.testing import CliRunner

from lensfit.cli.main import app

runner = CliRunner()


@pytest.fixture
def shoot(tmp_path: Path) -> Path:
    """The demo's plan with two of its six photographs."""
    for name in ("shoot.toml", "dots.exr", "lines.jpg"):
        shutil.copy(DEMO / name, tmp_path / name)
    return tmp_path / "shoot.toml"


def test_lines_name_what_is_found_and_what_is_missing(shoot: Path, tmp_path: Path):
    out = tmp_path / "checks"
    result = runner.invoke(app, ["check", "--shoot", str(shoot), "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert f"{tmp_path / 'dots.exr'}: good" in result.stdout
    assert "2 of 6 views done; missing: dots_near.png" in result.stdout
    for word in ("target", "frame", "light", "blur", "motion", "focus"):
        assert f"  {word} " in result.stdout
    with Image.open(out / "dots_check.png") as picture:
        assert picture.width == 1280
        assert picture.height > 960


def test_json_holds_the_same_a_line_each(shoot: Path, tmp_path: Path):
    images = [str(tmp_path / "dots.exr"), str(tmp_path / "lines.jpg")]
    result = runner.invoke(app, ["check", *images, "--shoot", str(shoot), "--json"])
    records = [json.loads(line) for line in result.stdout.splitlines()]
    assert [record["take"] for record in records] == ["dots.exr", "lines.jpg"]
    assert records[0]["points"] > 300
    assert records[0]["coverage"]["corners_reached"]
    states = {view["image"]: view["state"] for view in records[1]["plan"]}
    missing = [image for image, state in states.items() if state == "missing"]
    assert missing == [
        "dots_near.png",
        "dots_far.png",
        "dots_stopped.png",
        "dots_tilted.png",
    ]
    assert states["dots.exr"] == states["lines.jpg"] == "done"


def test_without_a_plan_the_chart_is_found_by_looking(tmp_path: Path):
    result = runner.invoke(app, ["check", str(DEMO / "dots.exr"), "--json"])
    record = json.loads(result.stdout)
    assert record["kind"] == "dot-grid"
    assert record["sharpness"]["holds_feature"]


def test_a_picture_without_a_chart_exits_1(tmp_path: Path):
    Image.new("RGB", (200, 200), (90, 90, 90)).save(tmp_path / "grey.png")
    result = runner.invoke(app, ["check", str(tmp_path / "grey.png")])
    assert result.exit_code == 1
    assert f"{tmp_path / 'grey.png'}: bad" in result.stdout


def test_a_file_that_is_none_is_one_line(tmp_path: Path):
    result = runner.invoke(app, ["check", str(tmp_path / "none.png")])
    assert result.exit_code == 1
    assert result.stderr.startswith("lensfit: error: ")
    assert result.stderr.count("\n") == 1


def test_nothing_to_check_is_wrong_usage():
    assert runner.invoke(app, ["check"]).exit_code == 2


def test_watching_checks_what_arrives_until_interrupted(tmp_path: Path):
    # Whoever runs the tests in the background has them inherit that Ctrl-C is ignored.
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    main = f"{heard}; from lensfit.cli.main import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", main, "check", "--watch", str(tmp_path), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    ) as run:
        time.sleep(1)
        shutil.copy(DEMO / "dots.exr", tmp_path / "dots.exr")
        assert run.stdout is not None
        record = json.loads(run.stdout.readline())
        assert record["image"] == str(tmp_path / "dots.exr")
        run.send_signal(signal.SIGINT)
        try:
            run.communicate(timeout=60)
        finally:
            run.kill()
    assert run.returncode != 0


def test_a_plan_without_its_photographs_fails(shoot: Path, tmp_path: Path):
    away = tmp_path / "away" / "shoot.toml"
    away.parent.mkdir()
    away.write_text(shoot.read_text(encoding="utf-8"), encoding="utf-8")
    done = runner.invoke(app, ["check", "--shoot", str(away)])
    assert done.exit_code == 1
    assert "photographs is there" in done.stderr


def test_an_output_without_a_name_is_wrong_usage(shoot: Path):
    done = runner.invoke(app, ["check", "--shoot", str(shoot), "--out", ""])
    assert done.exit_code == 2
    assert "is empty" in done.stderr


def test_what_calibrate_will_refuse_is_said(shoot: Path):
    text = shoot.read_text(encoding="utf-8")
    kept = [line for line in text.splitlines() if "sensor_" not in line]
    shoot.write_text("\n".join(kept), encoding="utf-8")
    done = runner.invoke(app, ["check", "--shoot", str(shoot)])
    assert "knows the sensor's width; add sensor_width_mm" in done.stdout

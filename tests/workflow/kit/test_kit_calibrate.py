"""A kit of traced lenses, calibrated through the command line and killed on the way."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from bundled_shoot import DEMO
from traced_kit import KIT, photograph_kit, write_kit_file
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.io.exr import ExrImage, read_exr, write_exr
from lensfit.workflow.kit.kit_file import load_kit
from lensfit.workflow.kit.lens_record import fingerprint
from lensfit.workflow.kit.lens_shoot import lens_shoot

runner = CliRunner()
LOST = """
[[lens]]
name = "Lost 50"
focal_length_mm = 50.0
"""


def placed(path: Path, folder: str, *names: str) -> None:
    """Empty files under these names: what is in them is not looked at."""
    place = path.parent / folder
    place.mkdir(exist_ok=True)
    for name in names:
        (place / name).write_bytes(b"")


def test_photographs_are_views_by_their_slates(tmp_path: Path):
    path = write_kit_file(tmp_path)
    placed(path, "wide-28_101", "wide-28_101_v01.png", "wide-28_101_v03.tif", "x.png")
    found = lens_shoot(load_kit(path), "wide-28_101")
    assert found.missing == ("wide-28_101_v02.png",)
    assert found.beside == ("x.png",)
    taken = [take.image for take in found.shoot().takes]
    assert taken == ["wide-28_101_v01.png", "wide-28_101_v03.tif"]
    assert "1 of 3 planned views are missing" in found.shoot().notes[-1]
    result = runner.invoke(app, ["kit", "check", str(path), "--lens", "101"])
    assert result.exit_code == 1
    assert "2 of 3 views; missing: wide-28_101_v02.png" in result.stdout
    assert "! x.png is no view of the plan" in result.stdout


def test_a_camera_that_numbers_its_files_is_read_by_their_headers(tmp_path: Path):
    path = write_kit_file(tmp_path)
    demo = read_exr(DEMO / "dots.exr").parts[0]
    place = tmp_path / "wide-28_101"
    place.mkdir()
    for name, focus_m in (("A001C002", 1.8288), ("A001C001", 1.12)):
        state = {"lens/focal": 28.0, "lens/fstop": 5.6, "lens/focus": focus_m}
        photograph = ExrImage((replace(demo, attributes=state),))
        write_exr(place / f"{name}.exr", photograph)
    found = lens_shoot(load_kit(path), "wide-28_101")
    by_view = {view: file.name for view, file in found.photographs.items()}
    assert by_view == {
        "wide-28_101_v01.png": "A001C001.exr",
        "wide-28_101_v02.png": "A001C002.exr",
    }


def test_a_folder_with_its_own_shoot_file_is_taken_as_that_says(tmp_path: Path):
    path = write_kit_file(tmp_path)
    placed(path, "wide-28_101", "b.png")
    (tmp_path / "wide-28_101" / "shoot.toml").write_text(
        '[lens]\nname = "Other"\n[[take]]\nimage = "b.png"\n[[take]]\nimage = "c.png"\n'
    )
    found = lens_shoot(load_kit(path), "wide-28_101")
    assert found.missing == ("c.png",)
    assert found.shoot().lens.name == "Other"


def test_what_a_calibration_reads_is_in_its_fingerprint(tmp_path: Path):
    path = write_kit_file(tmp_path)
    placed(path, "wide-28_101", "wide-28_101_v01.png")

    def mark(effort: str = "normal") -> str:
        return fingerprint(lens_shoot(load_kit(path), "wide-28_101").shoot(), effort)

    first = mark()
    assert mark() == first
    assert mark("best") != first
    placed(path, "wide-28_101", "wide-28_101_v02.png")
    second = mark()
    assert second != first
    (tmp_path / "wide-28_101" / "wide-28_101_v01.png").write_bytes(b"other")
    third = mark()
    assert third != second
    write_kit_file(tmp_path, KIT.replace("pitch_mm = 60.0", "pitch_mm = 61.0"))
    assert mark() != third


@pytest.mark.slow
def test_a_kit_is_killed_and_goes_on_without_loss(tmp_path: Path):
    path = write_kit_file(tmp_path / "kit")
    photograph_kit(path)
    write_kit_file(tmp_path / "kit", KIT + LOST)
    out = tmp_path / "out"
    first = out / "wide-28_101" / "kit_lens.json"
    command = [sys.executable, "-c", "from lensfit.cli.main import main; main()"]
    words = ["kit", "calibrate", str(path), "--out", str(out), "--workers", "1"]
    words += ["--effort", "none"]
    with subprocess.Popen([*command, *words], env=os.environ) as run:
        deadline = time.monotonic() + 1200
        while not first.exists() and run.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.2)
        run.send_signal(signal.SIGKILL)
    kept = first.stat().st_mtime_ns
    assert not (out / "wide-35_102" / "preset.json").exists()
    result = runner.invoke(app, [*words, "--json"])
    assert result.exit_code == 1  # of the lens that nobody photographed
    assert "lost-50: " in result.stderr
    assert "no view of the plan was photographed" in result.stderr
    assert first.stat().st_mtime_ns == kept
    table = json.loads(result.stdout)
    assert table == json.loads((out / "kit.json").read_text())
    states = {lens["folder"]: lens["state"] for lens in table["lenses"]}
    assert states == {"wide-28_101": "done", "wide-35_102": "done", "lost-50": "failed"}
    for lens in table["lenses"][:2]:
        focal = lens["focal_lengths"][0]
        assert lens["verdict"]["level"] in ("measurement", "match-moving")
        # Retrofocus lenses draw barrels, and larger the nearer they are focused.
        assert -4.0 < focal["distortion_percent"] < 0.0
        assert 0.0 < focal["breathing_percent"] < 4.0
        assert focal["fall_off"][0]["f_number"] == 5.6
        assert (out / lens["report"]).is_file()
    assert {one["quantity"] for one in table["sets"][0]["figures"]} >= {"distortion"}
    page = (out / "kit.html").read_text()
    assert "2 of 3 lenses are good for match-moving or better; look at Lost 50" in page
    shutil.rmtree(out / "wide-35_102" / "stmaps")
    seen = runner.invoke(app, ["kit", "report", str(path), "--out", str(out)])
    assert seen.exit_code == 1
    assert seen.stdout.splitlines()[0].startswith("2 of 3 lenses are good")

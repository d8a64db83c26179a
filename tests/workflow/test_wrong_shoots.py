"""Shoots that are wrong: none may end green, and the first line names the cause.

Traced photographs of one lens, wrongly stated or wrongly shot, through the command
line. Blur is not fitted (no hole diameter is stated), which keeps a case to seconds;
what is judged here is what was stated.
"""

import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from traced_views import write_traced
from typer.testing import CliRunner

from data_synth.bench.verdict.benchmark import wrong_row
from data_synth.bench.verdict.wrong_shoots import WRONG_SHOOTS, Wrong
from data_synth.bench.verdict.wrong_shoots import WrongShoot as Spoilt
from lensfit.cli.main import app
from lensfit.errors import ShootError
from lensfit.preset.store import load_preset
from lensfit.preset.verdict_levels import LEVELS
from lensfit.progress import silent
from lensfit.workflow.calibration.observe import observe_shoot
from lensfit.workflow.shoot.shoot_file import load_shoot
from lensfit.workflow.statements.blur_statements import contradicted_f_numbers
from lensfit.workflow.statements.contradictions import (
    contradictions_of_report,
    contradictions_of_views,
    gravest_first,
)
from lensfit.workflow.statements.repeated_exposures import without_repeated_exposures
from lensfit.workflow.statements.targets_seen import (
    contradicted_targets,
    missed_targets,
)

runner = CliRunner()
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A right shoot, and three views of another lens among its files."""
    folder = tmp_path_factory.mktemp("traced")
    write_traced(folder)
    other = tmp_path_factory.mktemp("other")
    write_traced(other, "flektogon_35", "other_")
    for picture in other.glob("*.png"):
        shutil.copy(picture, folder)
    return folder


class WrongShoot:
    """A copy of the traced shoot that a case spoils."""

    def __init__(self, traced: Path, folder: Path):
        shutil.copytree(traced, folder)
        self.folder, self.file = folder, folder / "shoot.toml"
        self.text = re.sub(r"hole_diameter_mm.*\n", "", self.file.read_text())

    def takes(self) -> list[str]:
        """The texts of all takes."""
        return self.text.split("[[take]]")[1:]

    def with_takes(self, takes: list[str]) -> None:
        """Put these takes in place of the others."""
        head = self.text.split("[[take]]")[0]
        self.text = "[[take]]".join([head, *takes])

    def calibrated(self, *options: str) -> tuple[dict, object]:
        """The report, and how the command ended."""
        self.file.write_text(self.text)
        out = self.folder / "out"
        result = runner.invoke(
            app, ["calibrate", str(self.file), "--out", str(out), "--json", *options]
        )
        assert result.stdout, result.stderr
        return json.loads(result.stdout), result


@pytest.fixture
def shoot(traced: Path, tmp_path: Path) -> WrongShoot:
    return WrongShoot(traced, tmp_path / "shoot")


def named(shoot: WrongShoot, kind: str, *words: str) -> dict:
    """The verdict of a wrong shoot, after what holds for all of them."""
    report, result = shoot.calibrated("--require", "measurement")
    judged = report["verdict"]
    first = judged["reasons"][0]
    assert judged["level"] != "measurement"
    assert first["tone"] in ("caution", "bad")
    assert "good" not in {reason["tone"] for reason in judged["reasons"]}
    assert first["kind"] == kind, judged["headline"]
    assert judged["headline"] == first["text"]
    assert first["remedy"]
    for word in words:
        assert word in judged["headline"]
    assert result.exit_code == 1
    assert f"the verdict is {judged['level']}, below measurement" in result.stderr
    page = (shoot.folder / "out" / "report.html").read_text()
    assert f'data-level="{judged["level"]}"' in page
    kept = load_preset(shoot.folder / "out" / "preset.json").verdict
    assert kept is not None
    assert kept.headline == judged["headline"]
    return report


def test_the_right_shoot_is_for_measurement_and_green(shoot: WrongShoot):
    report, result = shoot.calibrated("--require", "measurement")
    assert result.exit_code == 0, result.stderr
    assert report["contradictions"] == []
    judged = report["verdict"]
    assert judged["level"] == "measurement", judged["headline"]
    assert judged["reasons"][0]["tone"] == "good"
    assert report["held_out_rms_px"] <= 0.1
    # Objects are named in it, and count for the level from .3 px on.
    assert judged["accuracy_px"] <= 0.3
    assert judged["covered"] > 0.9


def test_near_and_far_swapped(shoot: WrongShoot):
    swapped = {"801.0": "1850.0", "1850.0": "801.0"}
    shoot.text = re.sub(
        r"focus_distance_mm = (801\.0|1850\.0)",
        lambda found: f"focus_distance_mm = {swapped[found[1]]}",
        shoot.text,
    )
    assert shoot.text.count("801.0") == 2
    named(shoot, "side_of_focus", "near and far are probably swapped")


def test_one_blurred_view(shoot: WrongShoot):
    path = shoot.folder / "dots_f5p6_in.png"
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    blurred = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 9 / 4)
    cv2.imwrite(str(path), np.round(blurred).astype(picture.dtype))
    # Beside one of the same stop, so that nothing but motion or focus explains it.
    takes = shoot.takes()
    takes[3] = takes[3].replace("f_number = 5.6", "f_number = 2.8")
    shoot.with_takes(takes)
    report = named(shoot, "blurred_view", "“dots_f5p6_in” is blurred")
    assert report["contradictions"][0]["images"] == ["dots_f5p6_in.png"]


def test_pitch_ten_percent_wrong(shoot: WrongShoot):
    pitch = float(re.search(r"pitch_mm = ([\d.]+)", shoot.text)[1])  # pyright: ignore
    wrong = round(1.1 * pitch, 4)
    shoot.text = shoot.text.replace(f"pitch_mm = {pitch}", f"pitch_mm = {wrong}", 1)
    report = named(shoot, "pitch", "pitch_mm of target", f"{wrong:.4g} mm")
    found = report["contradictions"][0]
    assert found["agrees_with"] == pytest.approx(pitch, rel=0.01)
    assert found["explained"] > 0.6


def test_35_stated_for_28(shoot: WrongShoot):
    shoot.text = shoot.text.replace("focal_length_mm = 28.0", "focal_length_mm = 35.0")
    shoot.file.write_text(shoot.text)
    out = shoot.folder / "out"
    result = runner.invoke(app, ["calibrate", str(shoot.file), "--out", str(out)])
    words = "focal_length_mm is stated as 35 mm, but the photographs agree with 2"
    first = (result.stdout + result.stderr).splitlines()[0]
    assert words in first
    if result.exit_code == 0:
        report = json.loads((out / "report.json").read_text())
        found = report["contradictions"][0]
        assert found["agrees_with"] == pytest.approx(28, rel=0.03)
        assert report["verdict"]["level"] in LEVELS[:3]


def test_f_numbers_far_from_stated(shoot: WrongShoot):
    shoot.text = shoot.text.replace("f_number = 5.6", "f_number = 8.0")
    report = named(shoot, "f_number", "f/8 is stated")
    assert report["contradictions"][0]["agrees_with"] == pytest.approx(5.6, rel=0.2)


def test_a_linear_file_taken_for_srgb(shoot: WrongShoot):
    shoot.text = shoot.text.replace('encoding = "linear"\n', "")
    report = named(shoot, "encoding", "encoding")
    kinds = [one["kind"] for one in report["contradictions"]]
    assert set(kinds) == {"encoding"}
    assert any("is not stated" in one["text"] for one in report["contradictions"])


def test_a_linear_file_stated_as_srgb(shoot: WrongShoot):
    shoot.text = shoot.text.replace('encoding = "linear"', 'encoding = "srgb"')
    named(shoot, "encoding", "cosine-fourth law")


def test_drafted_keys_that_nobody_confirmed(shoot: WrongShoot):
    shoot.text = shoot.text.replace(
        'kind = "dot-grid"', 'kind = "dot-grid"  # TODO: which', 1
    )
    named(shoot, "unconfirmed", "never confirmed: [[target]] 1, kind")


def test_one_exposure_four_times_over(shoot: WrongShoot):
    takes = shoot.takes()
    copies = []
    for k in range(4):
        name = f"copy_{k}.png"
        shutil.copy(shoot.folder / "dots_f2p8_in.png", shoot.folder / name)
        copies.append(takes[0].replace("dots_f2p8_in.png", name))
    shoot.with_takes(copies)
    report = named(shoot, "repeated_exposure", "one exposure is repeated", "copy_0.png")
    assert report["verdict"]["level"] in LEVELS[:3]
    assert sum(take["failed"] is None for take in report["takes"]) == 1


def test_too_few_views(shoot: WrongShoot):
    shoot.with_takes([shoot.takes()[0], shoot.takes()[7]])
    report = named(shoot, "too_few", "2 views cannot check each other")
    assert report["verdict"]["level"] == "undistortion"


def test_two_lenses_in_one_shoot(shoot: WrongShoot):
    takes = shoot.takes()
    mixed = [take.replace("dots_", "other_dots_") for take in takes[:3]]
    shoot.with_takes([*takes[3:6], *mixed])
    shoot.file.write_text(shoot.text)
    out = shoot.folder / "out"
    result = runner.invoke(app, ["calibrate", str(shoot.file), "--out", str(out)])
    first = (result.stdout + result.stderr).splitlines()[0]
    assert "two lenses or zoom settings are mixed at 28 mm" in first
    if result.exit_code == 0:
        report = json.loads((out / "report.json").read_text())
        assert report["verdict"]["level"] == "unusable"


def test_a_target_that_was_moved(shoot: WrongShoot):
    takes = shoot.takes()
    takes[1] = takes[1].replace(
        "target_distance_mm = 1120.0", "target_distance_mm = 1350.0"
    )
    shoot.with_takes(takes)
    report = named(shoot, "target_distance", "target_distance_mm of dots_f2p8_near")
    found = report["contradictions"][0]
    assert found["agrees_with"] == pytest.approx(1120, rel=0.02)


def named_by_views(shoot_file: Path) -> list[str]:
    """What is said of a shoot, in its order, before anything is fitted to it."""
    try:
        described = load_shoot(shoot_file)
    except ShootError as error:
        return [str(error)]
    observed, found = without_repeated_exposures(observe_shoot(described, None, silent))
    takes = [one.take for one in observed if one.take is not None]
    found += contradicted_targets(missed_targets(described, observed), observed)
    if not any(one.kind == "exchanged" for one in found):
        found += contradictions_of_views(takes)
    found += contradicted_f_numbers(takes)
    found += contradictions_of_report(described, observed, [])
    return [one.text for one in gravest_first(found)]


QUICK = (
    "pitch in inches", "pitch of one axis", "focal length of full frame",
    "sensor sides swapped", "mixed crops", "mixed sizes", "stretched",
    "rotated camera", "stops swapped", "files off by one", "copies saved again",
    "moved chart", "pitches swapped", "stop tenfold", "focus in wrong order",
    "one sensor mode", "a column too many", "gamma as linear", "two views coded",
    "over-exposed", "shaken", "wide adapter",
)  # fmt: skip
"""A second or two each; `lensfit bench verdict` tries all, to the end."""


@pytest.mark.parametrize(
    "case", [c for c in WRONG_SHOOTS if c.kind in QUICK], ids=lambda c: c.kind
)
def test_the_cause_is_known_before_anything_is_fitted(
    traced: Path, tmp_path: Path, case: Wrong
):
    shoot = Spoilt.copy_of(traced, tmp_path / "shoot")
    case.spoil(shoot)
    first, *_ = named_by_views(shoot.save())
    assert any(word in first for word in case.words), first


def test_nothing_is_said_of_the_right_one(traced: Path, tmp_path: Path):
    assert named_by_views(Spoilt.copy_of(traced, tmp_path / "shoot").save()) == []


def test_a_chart_that_is_not_there_is_not_green(traced: Path, tmp_path: Path):
    (case,) = [one for one in WRONG_SHOOTS if one.kind == "wrong chart"]
    row = wrong_row(case, Spoilt.copy_of(traced, tmp_path / "shoot"))
    assert row["named"], row["first_line"]
    assert not row["green"]

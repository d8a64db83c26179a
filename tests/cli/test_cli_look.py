"""Looks from the command line, the header and the preset: pictures, plans, refusals."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr

CAMERA = {
    "focal_length_mm": 35.0,
    "f_number": 1.4,
    "focus_distance_m": 4.0,
    "sensor_width_mm": 28.25,
    "width_px": 96,
    "height_px": 54,
}
HEADER = {"lens/focal": "35.0", "lens/focus": "4.0", "lens/fstop": "1.4"}


@pytest.fixture
def preset(tmp_path: Path) -> str:
    """An ideal lens focused at 4 m."""
    (tmp_path / "camera.json").write_text(json.dumps(CAMERA))
    path = str(tmp_path / "thin.json")
    made = ["preset", "thin-lens", str(tmp_path / "camera.json"), "--out", path]
    assert run(*made).exit_code == 0
    return path


def plate(folder: Path, header: dict[str, object] | None = None) -> str:
    """A dim plate with a light."""
    window = Window.of_size(96, 54)
    planes = {name: np.full((54, 96), 0.2, np.float32) for name in "RGB"}
    for plane in planes.values():
        plane[20, 30] = 100
    part = ExrPart(planes, window, window, {**HEADER, **(header or {})})
    write_exr(folder / "plate.0001.exr", ExrImage((part,)))
    return str(folder / "plate.0001.exr")


def applied(preset: str, path: str, folder: Path, *options: str) -> ExrPart:
    found = run("apply", preset, path, "--out", folder, "--no-defocus", *options)
    assert found.exit_code == 0, found.output
    return read_exr(folder / "plate.0001.exr").parts[0]


def rgb(part: ExrPart) -> np.ndarray:
    return np.stack([part.channels[name] for name in "RGB"], -1)


def test_options_header_and_preset_say_the_same(preset: str, tmp_path: Path):
    path = plate(tmp_path)
    by_option = applied(preset, path, tmp_path / "a", "--bloom-gain", "0.5")
    assert "bloom_gain 0.5" in str(by_option.attributes["lensfit/applied"])
    (tmp_path / "other").mkdir()
    with_entry = plate(tmp_path / "other", {"lensfit/bloom_gain": 0.5})
    by_header = applied(preset, with_entry, tmp_path / "b")
    found = json.loads(Path(preset).read_text())
    Path(preset).write_text(
        json.dumps({**found, "knobs": {"look": {"bloom_gain": 0.5}}})
    )
    by_preset = applied(preset, path, tmp_path / "c")
    assert np.array_equal(rgb(by_option), rgb(by_header))
    assert np.array_equal(rgb(by_option), rgb(by_preset))
    assert rgb(by_option)[20, 31, 0] > 1


def test_neutral_knobs_return_the_bits(preset: str, tmp_path: Path):
    gains = [f"--{name}-gain=0" for name in ("bloom", "glint", "pro-mist", "ghost")]
    rest = ["--white-balance-kelvin=6500", "--ghost-count=5"]
    path = plate(tmp_path)
    neutral = applied(preset, path, tmp_path / "a", *gains, *rest)
    assert rgb(neutral).tobytes() == rgb(read_exr(Path(path)).parts[0]).tobytes()


def test_the_plan_lists_looks_that_run_and_no_others(preset: str, tmp_path: Path):
    path = plate(tmp_path)
    options = [
        "--no-defocus",
        "--glint-gain",
        "0.2",
        "--white-balance-kelvin",
        "5000",
        "--json",
    ]
    found = run("plan", preset, path, *options)
    assert found.exit_code == 0, found.output
    stages = {s["stage"]: s for s in json.loads(found.stdout)["stages"]}
    assert {"glint", "white balance"} <= set(stages)
    assert not {"bloom", "pro-mist", "diffusion", "ghosting"} & set(stages)
    assert "20 % of the light above 4 in 6 streaks" in stages["glint"]["reason"]
    assert stages["glint"]["seconds"] > 0


def test_the_primaries_in_the_header_count(preset: str, tmp_path: Path):
    acescg = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
    balance = ("--white-balance-kelvin", "4000")
    plain = applied(preset, plate(tmp_path), tmp_path / "a", *balance)
    (tmp_path / "wide").mkdir()
    path = plate(tmp_path / "wide", {"chromaticities": acescg})
    wide = applied(preset, path, tmp_path / "b", *balance)
    assert np.abs(rgb(plain) - rgb(wide)).max() > 1e-3


def test_primaries_that_are_none_are_refused_in_a_line(preset: str, tmp_path: Path):
    path = plate(tmp_path, {"chromaticities": (0.3,) * 8})
    asked = ["apply", preset, path, "--out", str(tmp_path / "a"), "--no-defocus"]
    assert run(*asked).exit_code == 0
    found = run(*asked, "--overwrite", "--white-balance-tint", "9")
    assert found.exit_code == 1
    assert "span no colours" in found.stderr
    assert "Traceback" not in found.output


@pytest.mark.parametrize(
    "option", ["--bloom-gain 2", "--glint-streaks 0", "--white-balance-kelvin 500"]
)
def test_a_knob_beyond_its_end_is_wrong_usage(preset: str, tmp_path: Path, option: str):
    asked = ["apply", preset, plate(tmp_path), "--out", str(tmp_path / "a")]
    assert run(*asked, *option.split()).exit_code == 2


def test_a_header_beyond_its_end_is_one_line(preset: str, tmp_path: Path):
    path = plate(tmp_path, {"lensfit/bloom_gain": 7.0})
    found = run("apply", preset, path, "--out", tmp_path / "a")
    assert found.exit_code == 1
    assert "bloom_gain" in found.stderr

"""The recipes of README.md and of the guide, run word for word."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from bundled_shoot import DEMO, PHOTOGRAPHS, shoot_text_without_blur
from camera_files import arri
from documents import EVERYTHING, section

from data_synth.prescription import load_prescription
from data_synth.right_shoot import right_shots
from data_synth.sensor import Sensor
from data_synth.shoot import Camera, write_shoot
from data_synth.wavefront_cases import frame_for
from lensfit.io.exr import ExrImage, read_exr, write_exr
from lensfit.preset.schema import LensName
from lensfit.preset.store import load_preset, save_preset

GEOMETRY_ALONE = " --effort none"
"""Of recipes that calibrate: `lensfit demo` fits the blur of the same photographs."""
TINY = Path(__file__).parent / "cli" / "tiny_preset.json"


def recipe(heading: str) -> list[str]:
    """The commands below a heading."""
    block = re.search(r"```sh\n(.*?)```", section(EVERYTHING, heading), re.DOTALL)
    assert block is not None
    return block[1].strip().splitlines()


def run(line: str, folder: Path) -> str:
    """What a command prints; it must succeed."""
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", line],
        cwd=folder,
        env={**os.environ, "PATH": programs, "LENSFIT_LIBRARY": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr
    return done.stdout


@pytest.fixture
def calibrated(tmp_path: Path) -> Path:
    """A folder with a preset where the recipes have theirs."""
    preset = load_preset(TINY)
    named = msgspec.structs.replace(preset, lens=LensName("SMC Takumar 50/1.4"))
    (tmp_path / "takumar_50").mkdir()
    save_preset(named, tmp_path / "takumar_50" / "preset.json")
    return tmp_path


@pytest.mark.slow
def test_on_set(tmp_path: Path):
    grids = tmp_path / "grids"
    grids.mkdir()
    for photograph in PHOTOGRAPHS:
        shutil.copy(photograph, grids)
    chart, draft, check, calibrate, report = recipe("On set: measure a lens")
    run(chart, tmp_path)
    assert (tmp_path / "dots.pdf").read_bytes().startswith(b"%PDF")
    run(draft, tmp_path)
    assert "[[take]]" in (grids / "shoot.toml").read_text()
    (grids / "shoot.toml").write_text(shoot_text_without_blur())  # completed
    assert "dots" in run(check, tmp_path)
    run(calibrate + GEOMETRY_ALONE, tmp_path)
    made = tmp_path / "takumar_50"
    assert load_preset(made / "preset.json").entries
    assert (made / "report.html").is_file()
    assert len(list((made / "stmaps").glob("*.exr"))) == 6
    assert "px rms" in run(report, tmp_path)


KIT = """
[camera]
sensor_width_mm = 24.0
[[target]]
name = "dots"
kind = "dot-grid"
pitch_mm = 60.0
[[lens]]
name = "Demo 50"
folder = "demo_50"
focal_length_mm = 50.0
f_numbers = [5.6]
focus_marks = ["2 m"]
target_distance = "2 m"
"""


@pytest.mark.slow
def test_a_kit(tmp_path: Path):
    """Of one lens, whose folder has a shoot file of its own."""
    lens = tmp_path / "kit" / "demo_50"
    lens.mkdir(parents=True)
    for photograph in PHOTOGRAPHS:
        shutil.copy(photograph, lens)
    (lens / "shoot.toml").write_text(shoot_text_without_blur())
    (tmp_path / "kit" / "kit.toml").write_text(KIT)
    plan, check, calibrate, submit = recipe("On set: a kit of lenses")
    assert "demo_50_v01" in run(plan, tmp_path)
    assert "☐" in (tmp_path / "takes.html").read_text(encoding="utf-8")
    assert "6 of 6 views" in run(check, tmp_path)
    run(calibrate, tmp_path)
    made = tmp_path / "measured"
    assert (made / "demo_50" / "report.html").is_file()
    assert "1 of 1 lens is good" in (made / "kit.html").read_text(encoding="utf-8")
    again = (made / "demo_50" / "preset.json").stat().st_mtime_ns
    farm = run(submit, tmp_path).splitlines()[-1].partition("; ")[2]
    assert "openjd run" in farm
    run(farm, tmp_path)  # the lens is done: only the page is made again
    assert (made / "demo_50" / "preset.json").stat().st_mtime_ns == again


@pytest.mark.slow
@pytest.mark.parametrize(
    ("heading", "lens", "folder", "options"),
    [
        ("a zoom", "itoh_zoom", "zoom", {"every_focal_length": True}),
        ("an anamorphic lens", "schneider_31", "anamorphic", {}),
        ("a lens that focuses inside", "arri_100", "inside",
         {"distances": (18.0, 40.0)}),
    ],
)  # fmt: skip
def test_on_set_another_lens(
    tmp_path: Path, heading: str, lens: str, folder: str, options: dict
):
    prescription = load_prescription(lens)
    frame = frame_for(prescription, (320, 240))
    shots = right_shots(prescription, frame, 0, views=3, **options)
    write_shoot(tmp_path / folder, prescription, Camera(frame, Sensor()), shots)
    for line in recipe(f"On set: {heading}"):
        run(line + GEOMETRY_ALONE * (" calibrate " in line), tmp_path)
    (preset,) = tmp_path.glob("*/preset.json")
    states = {
        (e.focal_length_mm, e.focus_distance_mm) for e in load_preset(preset).entries
    }
    stated = {(one.focal_length_mm, one.focus_distance_mm) for one in shots}
    assert len(states) == len(stated)


@pytest.mark.slow
def test_in_the_pipeline(calibrated: Path):
    for line in recipe("In the pipeline: keep and hand on"):
        run(line, calibrated)
    level = calibrated / "show" / "sq010" / "sh0020" / "lenses" / "smc-takumar-50-1-4"
    assert "coma_gain" in (level / "v001.json").read_text()
    assert (
        calibrated / "show" / "lenses" / "smc-takumar-50-1-4" / "v001.json"
    ).is_file()
    assert len(list((calibrated / "maps").glob("*.exr"))) == 2
    assert "OpenTrackIO" in (calibrated / "takumar.json").read_text()


@pytest.mark.slow
def test_in_comp_and_on_the_farm(calibrated: Path):
    part = read_exr(DEMO / "plate.0001.exr").parts[0]
    camera = {"lens/focal": 50.0, "lens/fstop": 1.4, "lens/focus": 2.0}
    plate = ExrImage((replace(part, attributes=camera),))
    for number in (1001, 1002):
        write_exr(calibrated / f"plate.{number}.exr", plate)
    arri(calibrated, name="A001C001.csv")
    for line in recipe("In comp and on the farm: put it on CG"):
        run(line, calibrated)
    for folder in ("lens", "farm"):
        found = sorted(path.name for path in (calibrated / folder).glob("*.exr"))
        assert found == ["plate.1001.exr", "plate.1002.exr"]
    bloomed, plain = (
        read_exr(calibrated / folder / "plate.1001.exr").parts[0].channels["G"]
        for folder in ("lens", "farm")
    )
    assert (bloomed != plain).any()

"""What no source states: refused where it could be several things, told where not."""

import json

import numpy as np
import pytest
from command_line import run
from deep_files import write_deep
from plate_makers import CAMERA, DATA, SENSOR, make_preset, sharp, write_plate

from lensfit.errors import ImageError
from lensfit.plate.apply_options import ApplyOptions
from lensfit.plate.camera.sources import CameraOptions, StateOverrides
from lensfit.plate.frame.plate_lens import PlateLens
from lensfit.plate.plate_file import plate_header
from lensfit.preset.store import save_preset
from lensfit.rendering.render_stages import Switches
from lensfit.workflow.apply import apply
from lensfit.workflow.plan_plate import plan_plate

ALL = {**CAMERA, **SENSOR}
ENTRIES = {
    "focal_length_mm": ("lens/focal", "focal length", "35 mm"),
    "f_number": ("lens/fstop", "f-number", "2.8"),
    "focus_distance_mm": ("lens/focus", "focus distance", "2000 mm"),
    "sensor_width_mm": ("lens/aperture", "sensor width", "36 mm"),
}
Z = np.full((DATA.height, DATA.width), 6.0, np.float32)


def without(*names):
    lacking = [ENTRIES[name][0] for name in names]
    return {key: value for key, value in ALL.items() if key not in lacking}


def noted(plate, preset=None, **options):
    lens = PlateLens(preset or make_preset(), ApplyOptions(**options))
    lens.noted_state(plate_header(plate), plate)
    return lens.notes.said


def option(name):
    return "--" + name.replace("_", "-")


@pytest.mark.parametrize("name", ENTRIES)
def test_the_only_value_of_a_preset_is_used_and_told(tmp_path, name):
    plate = write_plate(tmp_path / "p.1001.exr", without(name))
    _, words, value = ENTRIES[name]
    (note,) = noted(plate)
    assert note.startswith(f"p.1001.exr: no {words} in the header; ")
    assert f", {value}, is used ({option(name)} states another)" in note
    stated = {"f_number": 2.8, "focus_distance_mm": 2000.0, "sensor_width_mm": 36.0}
    overrides = StateOverrides(**{name: {"focal_length_mm": 35.0, **stated}[name]})
    assert noted(plate, overrides=overrides) == []


def test_what_the_frame_does_not_depend_on_is_not_missed(tmp_path):
    plate = write_plate(tmp_path / "p.exr", without("f_number"))
    assert noted(plate, make_preset(stops=())) == []
    assert noted(plate, switches=Switches(falloff=False)) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_it_is_told_once_a_run(tmp_path, workers):
    for frame in (1001, 1002, 1003):
        write_plate(tmp_path / f"p.{frame}.exr", without("focal_length_mm"))
    done = apply(
        make_preset(),
        tmp_path / "p.####.exr",
        tmp_path / "out",
        options=sharp(),
        workers=workers,
    )
    assert len(done.written) == 3
    (note,) = (note for note in done.notes if "focal length" in note)
    assert note.startswith("p.1001.exr: ")


@pytest.mark.parametrize("lacking", [("f_number",), ("focus_distance_mm",), None])
@pytest.mark.parametrize("stops", [(), (2.8,)])
def test_depth_of_field_is_never_guessed(tmp_path, lacking, stops):
    lacking = lacking or ("f_number", "focus_distance_mm")
    plate = write_plate(tmp_path / "p.1001.exr", without(*lacking), {"Z": Z})
    preset = make_preset(stops=stops)
    (line,) = apply(preset, plate, tmp_path / "out").failures
    for name in lacking:
        for part in (ENTRIES[name][0], ENTRIES[name][1], option(name)):
            assert part in line
    for part in (str(plate), "which depth of field needs", "--no-defocus"):
        assert part in line
    with pytest.raises(ImageError) as planned:
        plan_plate(preset, plate, ApplyOptions())
    assert str(planned.value) == line
    # Either remedy works.
    flat = ApplyOptions(switches=Switches(defocus=False))
    assert apply(preset, plate, tmp_path / "flat", options=flat).failures == []
    values = {"f_number": 2.8, "focus_distance_mm": 2000.0}
    stated = ApplyOptions(overrides=StateOverrides(**{n: values[n] for n in lacking}))
    assert apply(preset, plate, tmp_path / "s", options=stated).failures == []


def test_a_deep_plate_needs_the_same(tmp_path):
    samples = {name: np.full(1, 0.5, np.float32) for name in "RGBA"}
    samples["Z"] = np.full(1, 4.0, np.float32)
    plate = write_deep(tmp_path / "p.1.exr", np.array([[1, 0]]), samples)
    (line,) = apply(make_preset(), plate, tmp_path / "out").failures
    assert "no f-number and no focus distance, which depth of field needs" in line


@pytest.mark.parametrize("output", ["filter", "aberration-dots"])
def test_a_picture_of_the_blur_needs_the_same(tmp_path, output):
    plate = write_plate(tmp_path / "p.1.exr", without("f_number"))
    options = ApplyOptions(output=output)
    out = tmp_path / "out"
    (line,) = apply(make_preset(), plate, out, options=options).failures
    assert "no f-number, which this picture needs" in line


@pytest.mark.parametrize("command", ["apply", "plan", "overscan", "inspect"])
def test_every_command_names_key_frame_and_option(tmp_path, command):
    save_preset(make_preset(24.0, 70.0), tmp_path / "zoom.json")
    plate = write_plate(tmp_path / "p.1001.exr", without("focal_length_mm"))
    preset = str(tmp_path / "zoom.json")
    words = {
        "apply": [preset, str(plate), "--out", str(tmp_path / "out"), "--no-defocus"],
        "plan": [preset, str(plate), "--no-defocus"],
        "overscan": [preset, "--plate", str(plate)],
        "inspect": [str(plate), "--preset", preset],
    }[command]
    result = run(command, *words)
    assert result.exit_code == 1
    (line,) = (
        line for line in result.stderr.splitlines() if line.startswith("lensfit: error")
    )
    for part in (str(plate), "no focal length", "lens/focal", "--focal-length-mm"):
        assert part in line
    given = run(command, *words, "--focal-length-mm", "24")
    assert given.exit_code == 0, given.stderr


def test_inspect_with_a_preset_shows_what_apply_would_take(tmp_path):
    save_preset(make_preset(), tmp_path / "prime.json")
    plate = write_plate(tmp_path / "p.1001.exr", without("focal_length_mm"))
    words = ["inspect", str(plate), "--preset", str(tmp_path / "prime.json")]
    result = run(*words, "--json")
    (record,) = json.loads(result.stdout)
    assert record["assumed"] == {
        "focal_length_mm": {"value": 35.0, "source": "the preset's only one"}
    }
    assert "p.1001.exr: no focal length in the header" in result.stderr
    assert "the preset's only one" in run(*words).stdout


def test_the_files_that_were_asked_are_told(tmp_path):
    (tmp_path / "s.toml").write_text("[camera]\nf_number = 2.8\n")
    plate = write_plate(tmp_path / "p.exr", without("focal_length_mm"))
    notes = noted(plate, camera=CameraOptions(settings=tmp_path / "s.toml"))
    assert any(f"in the header, {tmp_path / 's.toml'}; " in note for note in notes)

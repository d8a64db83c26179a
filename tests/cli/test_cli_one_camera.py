"""A result states one camera in its header: the one that was rendered with."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run_well
from plate_makers import CAMERA, DATA, DISPLAY, SENSOR, write_plate

from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.io.metadata import camera_words

OTHER = ("--focus-distance-mm", 1500, "--f-number", 4)
PITCH = {
    "sensorPhotositePitch": 10.0,
    "sensorAcquisitionRectangle": (
        np.array([8, 8], np.int32),
        np.array([3607, 2407], np.int32),
    ),
}
WHOLE = {"sensorOverallDimensions": np.array([40.0, 30.0], np.float32)}


def result(preset: Path, plate: Path, *options: object, command: str = "apply"):
    own = ("--no-defocus",) if command == "apply" else ()
    out = plate.parent / "out"
    done = run_well(command, preset, plate, "--out", out, *own, *options)
    return done.stderr, read_exr(out / plate.name)


@pytest.mark.parametrize("command", ["apply", "undistort"])
def test_every_entry_states_what_was_rendered_with(preset, tmp_path, command):
    text = {"exr/lens/focus": "2.0", "nuke/camera/focal": "35", "tStop": 3.0}
    plate = write_plate(tmp_path / "p.exr", {**CAMERA, **SENSOR, **text})
    other = ("--focus-distance-mm", 1500, "--f-number", 8)
    _, image = result(preset, plate, *other, command=command)
    header = image.parts[0].attributes
    assert header["lens/fstop"] == header["aperture"] == 8
    assert header["lens/focus"] == header["focus"] == pytest.approx(1.5)
    assert header["exr/lens/focus"] == "1.5"  # text stays text
    assert header["lens/focal"] == pytest.approx(35.0)
    assert "tStop" not in header  # of another f-number
    for name, words in camera_words(header).items():
        values = {w.value for w in words if not w.of_pinhole}
        assert len(values) <= 1, (name, words)
    (found,) = json.loads(run_well("inspect", tmp_path / "out/p.exr", "--json").stdout)
    assert found["state"]["f_number"] == 8
    assert not [note for note in found["notes"] if "contradicts" in note]


def test_every_part_does(preset, tmp_path):
    rgb = np.ones((DATA.height, DATA.width), np.float32)
    header = {**CAMERA, **SENSOR}
    parts = [ExrPart(dict.fromkeys("RGB", rgb), DATA, DISPLAY, header, name="rgb")]
    parts += [ExrPart({"Z": rgb}, DATA, DISPLAY, header, name="depth")]
    write_exr(tmp_path / "p.exr", ExrImage(tuple(parts)))
    _, image = result(preset, tmp_path / "p.exr", *OTHER)
    for part in image.parts:
        assert part.attributes["lens/fstop"] == 4
        assert part.attributes["lens/focus"] == pytest.approx(1.5)


def test_entries_of_the_projects_own_aliases_do(preset, tmp_path):
    (tmp_path / "lensfit.toml").write_text(
        '[aliases]\nfocus_distance_mm = { key = "cam/focus", unit = "cm" }\n'
    )
    plate = write_plate(tmp_path / "p.exr", {**CAMERA, **SENSOR, "cam/focus": 200.0})
    _, image = result(preset, plate, *OTHER)
    assert image.parts[0].attributes["cam/focus"] == pytest.approx(150.0)


def test_what_states_the_camera_keeps_its_bits(preset, tmp_path):
    header = {**CAMERA, **SENSOR, "tStop": 3.0, "lens/fstop": "2.8"}
    plate = write_plate(tmp_path / "p.exr", header)
    _, image = result(preset, plate)
    before = read_exr(plate).parts[0].attributes
    for name in header:
        assert image.parts[0].attributes[name] == before[name]


def test_the_whole_sensor_is_no_frame(preset, tmp_path):
    plate = write_plate(tmp_path / "p.exr", {**CAMERA, **WHOLE})
    said, image = result(preset, plate)
    assert "sensorOverallDimensions (40 x 30 mm) is the whole sensor" in said
    assert "36 mm wide" in str(image.parts[0].attributes["lensfit/applied"])
    header = image.parts[0].attributes
    # The camera's sensor stays what it is, and the frame's width is stated beside it.
    assert np.allclose(header["sensorOverallDimensions"], (40, 30))
    assert header["lens/aperture"] == pytest.approx(36.0)
    (found,) = json.loads(run_well("inspect", plate, "--json").stdout)
    assert "sensor_width_mm" not in found["state"]


def test_photosites_state_what_was_recorded(preset, tmp_path):
    plate = write_plate(tmp_path / "p.exr", {**CAMERA, **WHOLE, **PITCH})
    said, image = result(preset, plate)
    assert "whole sensor" not in said
    header = image.parts[0].attributes
    assert header["sensorPhotositePitch"] == 10.0
    assert "lens/aperture" not in header
    _, image = result(preset, plate, "--sensor-width-mm", 30, "--overwrite")
    header = image.parts[0].attributes
    assert "sensorAcquisitionRectangle" not in header  # of another frame
    assert header["lens/aperture"] == pytest.approx(30.0)


def test_a_frame_wider_than_its_sensor_is_noted(preset, tmp_path):
    plate = write_plate(tmp_path / "p.exr", {**CAMERA, **WHOLE, "lens/aperture": 50.0})
    (found,) = json.loads(run_well("inspect", plate, "--json").stdout)
    (note,) = found["notes"]
    assert "lens/aperture (50 mm) is used, which is more than sensorOverall" in note

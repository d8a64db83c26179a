"""`lensfit inspect` lists camera entries of a header that nothing reads."""

import json

import numpy as np
import pytest
from command_line import run
from plate_makers import CAMERA, SENSOR, write_plate

from lensfit.io.camera.header_entries import unmapped_entries

OTHERS = {
    "rs/camera/fov": 0.5,
    "arnold/camera/focal": 50.0,
    "ri:camera:fStop": 2.0,
    "karma:focus": 3.0,
    "husk:fstop": 2.8,
    "cameraFocalDistance": 2.0,
    "cameraTargetDistance": 200.0,
    "blender:camera:lens": 50.0,
}


def inspected(*words: object):
    done = run("inspect", *words)
    assert done.exit_code == 0, done.stderr
    return done.stdout


def test_what_nothing_reads_is_listed(tmp_path):
    plate = write_plate(tmp_path / "p.exr", {**CAMERA, **SENSOR, **OTHERS})
    (found,) = json.loads(inspected(plate, "--json"))
    assert found["not_read"].keys() == OTHERS.keys()
    assert found["not_read"]["husk:fstop"] == "2.8"
    shown = " ".join(inspected(plate).split())
    assert "not read" in shown
    assert "rs/camera/fov 0.5" in shown


def test_an_alias_of_the_project_reads_it(tmp_path):
    (tmp_path / "lensfit.toml").write_text('[aliases]\nf_number = "husk:fstop"\n')
    plate = write_plate(tmp_path / "p.exr", {"husk:fstop": 2.8, "karma:focus": 3.0})
    (found,) = json.loads(inspected(plate, "--json"))
    assert found["state"]["f_number"] == pytest.approx(2.8)
    assert list(found["not_read"]) == ["karma:focus"]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("nuke/camera/focal", "50"),
        ("exr/lens/focal", 50.0),
        ("pinholeFocalLength", 50.0),
        ("sensorPhotositePitch", 8.25),
        ("lensfit/focus_offset", 0.1),
        ("cameraMake", "ARRI"),
        ("vrayInfo/camera", "shot_cam"),
        ("cameraTransform", np.eye(4)),
        ("FocalPlaneXResolution", 100.0),
        ("screenWindowWidth", 1.0),
        ("owner", "camera crew"),
    ],
)
def test_what_is_read_or_tells_no_lens_is_not(key, value):
    assert unmapped_entries({key: value}) == {}

"""Stereo plates that state no views: their names tell, or they are refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from plate_makers import CAMERA, DATA, DISPLAY, SENSOR, scene

from lensfit.errors import ImageError
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.io.exr_views import eyes_of_channels

ALL = {**CAMERA, **SENSOR}
RIGHT = {**ALL, "lens/fstop": 2.0, "lens/focus": 4.0}
DEPTHS_M = {"left": 6.0, "right": 1.0}


def eye(view: str) -> dict[str, np.ndarray]:
    rgb = scene(DATA)[::-1] if view == "right" else scene(DATA)
    depth = np.full(rgb.shape[:2], DEPTHS_M[view], np.float32)
    return {n: rgb[..., i].copy() for i, n in enumerate("RGB")} | {"Z": depth}


def one_part(path: Path, *without: str) -> Path:
    channels = eye("left") | {f"right.{n}": s for n, s in eye("right").items()}
    kept = {n: s for n, s in channels.items() if n not in without}
    write_exr(path, ExrImage((ExrPart(kept, DATA, DISPLAY, ALL),)))
    return path


def two_parts(path: Path, names: tuple[str, str], right: dict = RIGHT) -> Path:
    parts = zip(names, ("left", "right"), (ALL, right), strict=True)
    made = (ExrPart(eye(v), DATA, DISPLAY, header, name=n) for n, v, header in parts)
    write_exr(path, ExrImage(tuple(made)))
    return path


def applied(preset: Path, plate: Path, out: Path, *options: object):
    depth = ("--depth-unit", "m", "--depth-kind", "perpendicular")
    done = run("apply", preset, plate, "--out", out, *depth, *options)
    assert done.exit_code == 0, done.stderr
    return done.stderr, read_exr(out / plate.name)


def mono(preset: Path, folder: Path, view: str, header: dict) -> ExrPart:
    path = folder / f"{view}.exr"
    write_exr(path, ExrImage((ExrPart(eye(view), DATA, DISPLAY, header),)))
    return applied(preset, path, folder / "alone")[1].parts[0]


def test_an_eye_of_one_part_is_rendered_with_its_own_depth(preset, tmp_path):
    plate = one_part(tmp_path / "stereo.exr")
    _, image = applied(preset, plate, tmp_path / "out")
    assert set(image.parts[0].channels) == set(read_exr(plate).parts[0].channels)
    for view, prefix in (("left", ""), ("right", "right.")):
        wanted = mono(preset, tmp_path, view, ALL)
        for name in "RGB":
            own = image.parts[0].channels[prefix + name]
            assert own.tobytes() == wanted.channels[name].tobytes()
    again = run("apply", preset, plate, "--out", tmp_path / "out", "--depth-unit", "m",
                "--depth-kind", "perpendicular", "--json")  # fmt: skip
    assert len(json.loads(again.stdout)["skipped"]) == 1


def test_a_layer_without_depth_may_be_a_light_and_is_noted(preset, tmp_path):
    plate = one_part(tmp_path / "lights.exr", "right.Z")
    said, _ = applied(preset, plate, tmp_path / "out")
    assert "layer 'right' is rendered with Z and with the plate's camera" in said


def test_a_layer_with_another_depth_is_noted(preset, tmp_path):
    channels = eye("left") | {f"fg.{n}": s for n, s in eye("right").items()}
    plate = tmp_path / "layers.exr"
    write_exr(plate, ExrImage((ExrPart(channels, DATA, DISPLAY, ALL),)))
    said, _ = applied(preset, plate, tmp_path / "out")
    assert "layer 'fg' has a depth of its own (fg.Z), and is rendered with Z" in said


@pytest.mark.parametrize("names", [("left", "right"), ("rgba.left", "rgba.right")])
def test_parts_of_two_eyes_have_their_own_cameras(preset, tmp_path, names):
    plate = two_parts(tmp_path / "stereo.exr", names)
    _, image = applied(preset, plate, tmp_path / "out")
    for part, view, header in zip(
        image.parts, ("left", "right"), (ALL, RIGHT), strict=True
    ):
        wanted = mono(preset, tmp_path, view, header)
        assert part.channels["G"].tobytes() == wanted.channels["G"].tobytes()


def test_parts_of_two_cameras_that_are_no_eyes_are_refused(preset, tmp_path):
    plate = two_parts(tmp_path / "p.exr", ("near", "far"))
    done = run("apply", preset, plate, "--out", tmp_path / "out", "--no-defocus")
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1
    assert "the f-number of part 'far' is 2, that of part 'near' is 2.8" in done.stderr
    stated = ("--f-number", 2.8, "--focus-distance-mm", 2000)
    applied(preset, plate, tmp_path / "out", *stated)
    applied(preset, two_parts(plate, ("near", "far"), ALL), tmp_path / "same")


def test_inspect_names_the_view_and_what_others_state(tmp_path):
    plate = two_parts(tmp_path / "p.exr", ("left", "right"))
    done = run("inspect", plate, "--json")
    (found,) = json.loads(done.stdout)
    assert found["views"] == ["left", "right"]
    assert found["state"]["f_number"] == pytest.approx(2.8)
    said = "the camera is that of view 'left'; view 'right' states f_number 2.0"
    assert said in done.stderr
    shown = run("inspect", plate).stdout
    assert "the camera is that of left" in " ".join(shown.split())


def test_overscan_of_a_stereo_plate_names_the_view(preset, tmp_path):
    plate = two_parts(tmp_path / "p.exr", ("left", "right"))
    done = run("overscan", preset, "--plate", plate)
    assert done.exit_code == 0, done.stderr
    assert "the overscan is that of view 'left'" in done.stderr


def test_channels_of_both_eyes_beside_a_third_picture_are_refused(preset, tmp_path):
    channels = eye("left")
    channels |= {f"{v}.{n}": s for v in DEPTHS_M for n, s in eye(v).items()}
    plate = tmp_path / "three.exr"
    write_exr(plate, ExrImage((ExrPart(channels, DATA, DISPLAY, ALL),)))
    done = run("apply", preset, plate, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert f"{plate}: names the channels of left and right beside" in done.stderr


def test_eyes_are_spelled_as_in_the_file():
    right = ["R", "G", "B", "Right.R", "Right.G", "Right.B", "Right.Z"]
    assert eyes_of_channels(right) == ["left", "Right"]
    assert eyes_of_channels([f"depth.{n}" for n in "RGB"]) == []
    both = [f"{eye}.{n}" for eye in ("right", "left") for n in "RGBZ"]
    assert eyes_of_channels(both) == ["left", "right"]
    with pytest.raises(ImageError, match="beside colours of no eye"):
        eyes_of_channels([*both, *"RGB"])

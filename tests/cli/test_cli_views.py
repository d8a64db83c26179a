"""Stereo plates: each view is rendered as if it were a plate of its own."""

import json
from pathlib import Path

import numpy as np
import pytest
from deep_files import write_deep
from plate_makers import CAMERA, DATA, DISPLAY, SENSOR, scene
from typer.testing import CliRunner

from lensfit.cli.main import app
from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, read_exr, write_exr
from lensfit.io.exr_views import joined_views, views_of

ALL = {**CAMERA, **SENSOR}
RIGHT = {**ALL, "lens/fstop": 2.0, "lens/focus": 4.0}
NO_CAMERA: dict[str, object] = {}
DEPTHS_M = {"left": 6.0, "right": 1.0}


def eye(view: str) -> dict[str, np.ndarray]:
    """Colours and depth of one eye; the right one looks at other pixels."""
    rgb = scene(DATA)[::-1] if view == "right" else scene(DATA)
    depth = np.full(rgb.shape[:2], DEPTHS_M[view], np.float32)
    depth[:, 60:] = 2.0
    return {n: rgb[..., i].copy() for i, n in enumerate("RGB")} | {"depth.Z": depth}


def mono(path: Path, view: str, header: dict[str, object]) -> Path:
    write_exr(path, ExrImage((ExrPart(eye(view), DATA, DISPLAY, header),)))
    return path


def parts_file(path: Path, right: dict[str, object]) -> Path:
    """A part for each eye."""
    parts = [
        ExrPart(eye(view), DATA, DISPLAY, {**header, "view": view}, name=f"rgba.{view}")
        for view, header in (("left", ALL), ("right", right))
    ]
    write_exr(path, ExrImage(tuple(parts)))
    return path


def names_file(path: Path, style: str) -> Path:
    """Both eyes in one part, the right one by the names of its channels."""
    channels = eye("left")
    for name, samples in eye("right").items():
        layer, _, leaf = name.rpartition(".")
        words = ["right", layer, leaf] if style == "before" else [layer, "right", leaf]
        channels[".".join(word for word in words if word)] = samples
    header = {**ALL, "multiView": ["left", "right"]}
    write_exr(path, ExrImage((ExrPart(channels, DATA, DISPLAY, header),)))
    return path


def run(command: str, preset: Path, plate: Path, *options: object):
    words = [command, preset, plate, "--depth-unit", "m", "--depth-kind"]
    words += ["perpendicular", *options]
    return CliRunner().invoke(app, [str(word) for word in words])


def applied(preset: Path, plate: Path, out: Path, *options: object) -> ExrImage:
    done = run("apply", preset, plate, "--out", out, "--json", *options)
    assert done.exit_code == 0, done.stderr
    return read_exr(json.loads(done.stdout)["written"][0])


def test_each_part_is_rendered_with_its_own_depth_and_camera(preset, tmp_path):
    plate = parts_file(tmp_path / "stereo.exr", RIGHT)
    left, right = applied(preset, plate, tmp_path / "out").parts
    assert (left.name, right.name) == ("rgba.left", "rgba.right")
    assert (left.attributes["view"], right.attributes["view"]) == ("left", "right")
    for view, header, part in (("left", ALL, left), ("right", RIGHT, right)):
        alone = mono(tmp_path / f"{view}.exr", view, header)
        (wanted,) = applied(preset, alone, tmp_path / "alone").parts
        for name, samples in wanted.channels.items():
            assert part.channels[name].tobytes() == samples.tobytes()
        assert (
            part.attributes["lensfit/applied"] == wanted.attributes["lensfit/applied"]
        )
    done = run("apply", preset, plate, "--out", tmp_path / "out", "--json")
    assert len(json.loads(done.stdout)["skipped"]) == 1


@pytest.mark.parametrize("style", ["before", "between"])
def test_views_within_one_part_are_told_by_their_names(preset, tmp_path, style):
    plate = names_file(tmp_path / "stereo.exr", style)
    (part,) = applied(preset, plate, tmp_path / "out").parts
    assert part.attributes["multiView"] == ["left", "right"]
    assert set(part.channels) == set(read_exr(plate).parts[0].channels)
    for view, prefix in (("left", ""), ("right", "right.")):
        alone = mono(tmp_path / f"{view}.exr", view, ALL)
        (wanted,) = applied(preset, alone, tmp_path / "alone").parts
        for name in "RGB":
            own = part.channels[prefix + name]
            assert own.tobytes() == wanted.channels[name].tobytes()


def test_the_eyes_are_focused_at_one_distance(preset, tmp_path):
    plate = parts_file(tmp_path / "stereo.exr", ALL)
    pick = ("--out", tmp_path / "out", "--focus-at", "10,10")
    done = run("apply", preset, plate, *pick)
    assert done.exit_code == 0, done.stderr
    for part in read_exr(tmp_path / "out" / "stereo.exr").parts:
        assert "6050 mm focus" in str(part.attributes["lensfit/applied"])
    assert "all views are focused on what view 'left' has at --focus-at" in done.stderr
    # What was finished so is not rendered again.
    again = run("apply", preset, plate, *pick, "--json")
    assert len(json.loads(again.stdout)["skipped"]) == 1


def test_a_view_without_a_camera_takes_the_others_and_says_so(preset, tmp_path):
    plate = parts_file(tmp_path / "stereo.exr", NO_CAMERA)
    done = run("apply", preset, plate, "--out", tmp_path / "out", "--json")
    notes = json.loads(done.stdout)["notes"]
    assert [n for n in notes if "view 'right' states no camera" in n]
    _, right = read_exr(tmp_path / "out" / "stereo.exr").parts
    alone = mono(tmp_path / "right.exr", "right", ALL)
    (wanted,) = applied(preset, alone, tmp_path / "alone").parts
    assert right.channels["G"].tobytes() == wanted.channels["G"].tobytes()


def test_a_view_without_depth_does_not_take_the_others(preset, tmp_path):
    plate = parts_file(tmp_path / "stereo.exr", ALL)
    left, right = read_exr(plate).parts
    channels = {n: s for n, s in right.channels.items() if n != "depth.Z"}
    bare = ExrPart(channels, DATA, DISPLAY, right.attributes, name=right.name)
    write_exr(plate, ExrImage((left, bare)))
    done = run("apply", preset, plate, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert f"{plate}: view 'right' has no depth channel" in done.stderr
    # A part of no view is everybody's.
    depth = ExrPart({"Z": left.channels["depth.Z"]}, DATA, DISPLAY, name="depth")
    write_exr(plate, ExrImage((left, depth, bare)))
    shared = applied(preset, plate, tmp_path / "out")
    assert [p.name for p in shared.parts] == ["rgba.left", "depth", "rgba.right"]


def test_what_is_of_one_view_is_refused_or_named(preset, tmp_path):
    plate = parts_file(tmp_path / "stereo.exr", ALL)
    picture = ("--output", "circle-of-confusion")
    done = run("apply", preset, plate, "--out", tmp_path / "out", *picture)
    assert done.exit_code == 1
    assert "several views (left, right)" in done.stderr
    assert "the plan is that of view 'left'" in run("plan", preset, plate).stderr


def test_deep_pixels_of_several_views_are_refused(preset, tmp_path):
    counts = np.ones((4, 4), int)
    samples = {n: np.ones(16, np.float32) for n in "RGBAZ"}
    header = {**ALL, "multiView": ["left", "right"]}
    plate = write_deep(tmp_path / "deep.exr", counts, samples, header)
    done = run("apply", preset, plate, "--out", tmp_path / "out")
    assert done.exit_code == 1
    assert "deep pixels of several views" in done.stderr


@pytest.mark.parametrize("views", [["left"], ["left", "right"]])
def test_splitting_and_joining_is_the_same_file(tmp_path, views):
    for number, path in enumerate(
        (
            names_file(tmp_path / "a.exr", "before"),
            parts_file(tmp_path / "b.exr", RIGHT),
            mono(tmp_path / "c.exr", "left", {**ALL, "multiView": views}),
        )
    ):
        image = read_exr(path)
        found = views_of(image)
        assert len(found) == (2, 2, 1)[number]
        if len(found) < 2:
            assert found[0].image is image
            continue
        again = joined_views(image, found, [view.image for view in found])
        for part, own in zip(again.parts, image.parts, strict=True):
            assert set(part.channels) == set(own.channels)
            assert all((part.channels[n] == s).all() for n, s in own.channels.items())
            assert part.attributes.keys() == own.attributes.keys()


def test_views_of_other_windows_meet_in_one_part():
    plane = np.ones((2, 2), np.float32)
    window = Window.of_size(2, 2)
    header: dict[str, object] = {"multiView": ["left", "right"]}
    image = ExrImage((ExrPart({"Y": plane, "right.Y": plane}, window, window, header),))
    left, right = views_of(image)
    grown = ExrPart({"Y": np.ones((2, 4), np.float32)}, Window(0, 0, 3, 1), window)
    (part,) = joined_views(image, [left, right], [left.image, ExrImage((grown,))]).parts
    assert part.data_window == Window(0, 0, 3, 1)
    assert part.channels["Y"].sum() == 4
    assert part.channels["right.Y"].sum() == 8
    wide = ExrPart({"Y": np.ones((2, 4), np.float32)}, Window(0, 0, 3, 1), window)
    (part,) = joined_views(image, [left, right], [ExrImage((wide,)), right.image]).parts
    assert (part.channels["Y"].sum(), part.channels["right.Y"].sum()) == (8, 4)

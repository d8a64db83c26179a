"""Cameras of Nuke: .chan, and camera nodes with their curves."""

import camera_files as files
import pytest

from lensfit.errors import CameraError
from lensfit.io.camera.nuke_camera import read_chan, read_nuke_camera
from lensfit.io.camera.read_camera_file import read_camera_file
from lensfit.io.camera.table import FrameKey


def at(camera, frame, name):
    return camera.at(FrameKey(frame), None)[0][name].value


def test_chan_knows_its_frames(tmp_path):
    camera = read_chan(files.chan(tmp_path, f1001=30.0, f1002=31.5))
    assert at(camera, 1002, "vertical_fov_deg") == 31.5
    # The first row of a table that counts for itself is stated by nobody.
    assert camera.at(FrameKey(1001), 5)[0]["vertical_fov_deg"].value == 30.0
    with pytest.raises(CameraError, match="frame 1003"):
        camera.at(FrameKey(1003), None)
    with pytest.raises(CameraError, match="no frame number"):
        camera.at(FrameKey(), None)


@pytest.mark.parametrize("node", ["Camera", "Camera2", "Camera3", "Camera4"])
def test_camera_nodes(tmp_path, node):
    knobs = ("focal 35", "haperture 24.89", "vaperture 18.67", "fstop 2.8")
    camera = read_camera_file(files.nuke(tmp_path, *knobs, node=node))
    found, place = camera.at(FrameKey(), None)
    assert {name: reading.value for name, reading in found.items()} == {
        "pinhole_focal_length_mm": 35.0,
        "sensor_width_mm": 24.89,
        "sensor_height_mm": 18.67,
        "f_number": 2.8,
    }
    assert place == "Camera1"
    assert found["pinhole_focal_length_mm"].entry == "focal"


def test_a_knob_at_its_default_is_not_taken(tmp_path):
    camera = read_nuke_camera(files.nuke(tmp_path, "focal 35"))
    assert set(camera.at(FrameKey(), None)[0]) == {"pinhole_focal_length_mm"}
    with pytest.raises(CameraError, match="states none of focal"):
        read_nuke_camera(files.nuke(tmp_path))


@pytest.mark.parametrize("braces", ["{{curve %s}}", "{curve %s}"])
def test_curves(tmp_path, braces):
    keys = "i x1001 50 x1011 s0.5 80 K x1021 20 x1031 30"
    camera = read_nuke_camera(files.nuke(tmp_path, f"focal {braces % keys}"))
    wanted = {990: 50, 1001: 50, 1006: 65, 1011: 80, 1021: 20, 1030: 20, 1099: 30}
    assert {f: at(camera, f, "pinhole_focal_length_mm") for f in wanted} == wanted
    assert any("straight lines" in note for note in camera.notes)


def test_baked_curves_name_their_first_frame_only(tmp_path):
    camera = read_nuke_camera(files.nuke(tmp_path, "focal {{curve x1001 35 36 37}}"))
    assert [at(camera, f, "pinhole_focal_length_mm") for f in (1001, 1002, 1003)] == [
        35,
        36,
        37,
    ]
    assert camera.notes == ()
    with pytest.raises(CameraError, match="animated"):
        camera.at(FrameKey(), None)


def test_focus_counts_from_the_camera_in_units_of_the_scene(tmp_path):
    path = files.nuke(tmp_path, "focal_point 3")
    assert at(read_nuke_camera(path), 1, "focus_from_pupil_mm") == 3000
    assert "metres" in read_nuke_camera(path).notes[0]
    stated = read_nuke_camera(path, unit_mm=10.0)
    assert (at(stated, 1, "focus_from_pupil_mm"), stated.notes) == (30, ())


def test_an_expression_is_told_and_not_guessed(tmp_path):
    path = files.nuke(tmp_path, 'focal {{"parent.lens * 2" i}}', "fstop 4")
    camera = read_nuke_camera(path)
    assert set(camera.at(FrameKey(), None)[0]) == {"f_number"}
    assert "bake" in camera.notes[0]


def test_several_cameras_are_told_apart_by_name(tmp_path):
    first = files.nuke(tmp_path, "focal 35", name="wide").read_text()
    path = files.nuke(tmp_path, "focal 85", name="tele")
    path.write_text(first + path.read_text())
    with pytest.raises(CameraError, match="wide, tele with --camera-name"):
        read_nuke_camera(path)
    with pytest.raises(CameraError, match="no camera 'other'"):
        read_nuke_camera(path, "other")
    assert at(read_nuke_camera(path, "tele"), 1, "pinhole_focal_length_mm") == 85


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Blur {\n size 9\n}\n", "no camera node"),
        ("Camera2 {\n focal 50\n", "never closed"),
        ("Camera2 {\n focal {{curve x1 5", "never closed"),
        ("Camera2 {\n focal nan\n}\n", "Camera2_1.focal is 'nan'"),
        ("Camera2 {\n focal {{curve x1 nan}}\n}\n", "Camera2_1.focal is 'nan'"),
        ("Camera2 {\n focal {{curve x1 1e99}}\n}\n", "Camera2_1.focal is '1e99'"),
        ("Camera2 {\n focal {{curve}}\n}\n", "no curve"),
        ("Camera2 {\n focal -50\n}\n", "focal is -50"),
        ("Camera2 {\n" * 5000, "never closed"),
        ("Camera2 {\n focal " + "{" * 99_999, "never closed"),
        ("Camera2 {\n" + "a b\n" * (1 << 20) + "}\n", "too large"),
        ("Camera2 {\n focal 1 }\n" * 1001, "1000 cameras"),
    ],
)
def test_broken_scripts_are_refused_in_one_line(tmp_path, text, said):
    path = tmp_path / "bad.nk"
    path.write_text(text)
    with pytest.raises(CameraError, match=said) as caught:
        read_nuke_camera(path).at(FrameKey(1), None)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_quotes_and_braces_inside_words(tmp_path):
    path = files.nuke(tmp_path, r'label "a } \" { b"', "focal 40", "rotate {0 90 0}")
    assert at(read_nuke_camera(path), 1, "pinhole_focal_length_mm") == 40
    assert at(read_nuke_camera(path), None, "pinhole_focal_length_mm") == 40

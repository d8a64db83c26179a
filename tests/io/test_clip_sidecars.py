"""Sidecars of clips: ALE, Sony's XML, recordings of Mo-Sys F4."""

import camera_files as files
import pytest

from lensfit.errors import CameraError
from lensfit.io.camera.read_camera_file import read_camera_file
from lensfit.io.camera.table import FrameKey


def values(camera, **key: object) -> dict[str, object]:
    readings, _ = camera.at(FrameKey(**key), None)  # pyright: ignore
    return {name: reading.value for name, reading in readings.items()}


def test_a_row_of_an_ale_belongs_to_the_plates_named_as_its_clip(tmp_path):
    camera = read_camera_file(files.ale(tmp_path))
    first = {
        "focal_length_mm": 50.0,
        "t_number": 2.8,
        "focus_distance_mm": 2000.0,
        "lens_model": "Biotar",
    }
    assert values(camera, stem="A001C001") == first
    assert values(camera, stem="a001c001_v02.1001", number=1001) == first
    second = values(camera, stem="A001C002.1001")
    assert second["t_number"] == 4
    assert second["focus_distance_mm"] == pytest.approx(1498.6)


def test_and_to_those_with_its_timecode(tmp_path):
    camera = read_camera_file(files.ale(tmp_path))
    assert values(camera, stem="plate", timecode="01:00:03:23")["t_number"] == 2.8
    assert values(camera, stem="plate", timecode="01:00:10:00")["t_number"] == 4
    for key in ({"timecode": "01:00:04:00"}, {}):  # an end is the first frame after it
        with pytest.raises(CameraError, match="has no clip of 'plate'") as caught:
            values(camera, stem="plate", **key)
        assert "A001C001, A001C002" in str(caught.value)


def test_one_clip_is_everybodys(tmp_path):
    camera = read_camera_file(files.ale(tmp_path, files.ALE_CLIPS[0]))
    assert values(camera, stem="other")["focal_length_mm"] == 50


def test_clips_of_one_name_that_differ_are_refused(tmp_path):
    again = files.ALE_CLIPS[0].replace("T2.8", "T5.6")
    camera = read_camera_file(files.ale(tmp_path, files.ALE_CLIPS[0], again))
    with pytest.raises(CameraError, match="several clips of 'A001C001' that differ"):
        values(camera, stem="A001C001")


@pytest.mark.parametrize(
    ("cell", "wrong", "said"),
    [
        ("2.0 m", "2.0", "line 9: focus distance = '2.0' is no length"),
        ("T2.8", "wide", "line 9: t-stop is 'wide'"),
        ("50mm", "long", "line 9: focal length is 'long'"),
    ],
)
def test_a_bad_cell_is_named(tmp_path, cell, wrong, said):
    path = files.ale(tmp_path, files.ALE_CLIPS[0].replace(cell, wrong))
    with pytest.raises(CameraError, match=said) as caught:
        read_camera_file(path)
    assert caught.value.where == path


def test_an_ale_without_a_lens_is_none(tmp_path):
    path = files.ale(tmp_path, "A\t01:00:00:00", columns="Name\tStart")
    with pytest.raises(CameraError, match="without a column of the lens"):
        read_camera_file(path)


def test_sonys_xml_tells_what_stays(tmp_path):
    camera = read_camera_file(files.sony_xml(tmp_path))
    assert values(camera) == {"camera_model": "MPC-3610", "lens_model": "S7i-32"}
    assert "the clip's table of frames" in camera.notes[0]


@pytest.mark.parametrize("declared", ["UTF-16", "UTF1e", "x-none", "shift_jis"])
def test_the_encoding_that_a_decoded_xml_declares_does_not_count(tmp_path, declared):
    path = files.sony_xml(tmp_path)
    path.write_text(path.read_text().replace("UTF-8", declared))
    assert values(read_camera_file(path))["camera_model"] == "MPC-3610"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</NonRealTimeMeta>", "", "is not valid XML"),
        ("<?xml", '<!DOCTYPE a [<!ENTITY b "c">]><?xml', "entities"),
        ("modelName", "name", "without a camera or a lens"),
    ],
)
def test_a_bad_xml_is_named(tmp_path, old, new, said):
    path = files.sony_xml(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(CameraError, match=said):
        read_camera_file(path)


def test_a_recording_of_f4_goes_by_timecode(tmp_path):
    camera = read_camera_file(files.mosys(tmp_path, 2.5, 4.0))
    first = values(camera, timecode="15:03:47:02")
    # Its focal length is none in millimetres.
    assert first == {
        "focus_distance_mm": pytest.approx(2500, rel=1e-6),
        "f_number": pytest.approx(2.8),
    }
    second = values(camera, timecode="15:03:47:03")
    assert second["focus_distance_mm"] == pytest.approx(4000, rel=1e-6)
    assert "the focal length comes from another source" in camera.notes[0]


def test_focus_at_infinity_is_no_distance_of_a_recording(tmp_path):
    blocks = files.mosys_block(0x57, 0.0), files.mosys_block(0x60, 4.0)
    path = tmp_path / "far.bin"
    path.write_bytes(files.mosys_packet(*blocks))
    assert values(read_camera_file(path)) == {"f_number": 4.0}


def test_a_recording_that_was_cut_off_is_read_as_far_as_it_goes(tmp_path):
    path = files.mosys(tmp_path, 2.5, 4.0)
    path.write_bytes(path.read_bytes()[:-3])
    camera = read_camera_file(path)
    assert values(camera)["focus_distance_mm"] == pytest.approx(2500, rel=1e-6)


@pytest.mark.parametrize(
    ("at", "byte", "said"),
    [
        (7, 0x11, "checksum of the packet at byte 0"),
        (25, 0x00, "damaged at byte 25"),
        (0, 0x00, "damaged at byte 0"),
        (2, 0xFF, "damaged at byte 0"),
    ],
)
def test_a_damaged_recording_is_named(tmp_path, at, byte, said):
    path = files.mosys(tmp_path)
    data = bytearray(path.read_bytes())
    data[at] = byte
    path.write_bytes(data)
    with pytest.raises(CameraError, match=said) as caught:
        read_camera_file(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [float("nan"), -1.0])
def test_a_number_that_cannot_be_is_named(tmp_path, value):
    path = tmp_path / "bad.f4"
    path.write_bytes(files.mosys_packet(files.mosys_block(0x60, value)))
    with pytest.raises(CameraError, match="packet at byte 0: field 60 is"):
        read_camera_file(path)


def test_a_recording_without_a_lens_is_refused(tmp_path):
    path = tmp_path / "pose.f4"
    path.write_bytes(files.mosys_packet(files.mosys_block(0x01, b"\0\0\0\1")))
    with pytest.raises(CameraError, match="without a focus distance or an f-number"):
        read_camera_file(path)

"""Sidecars of cameras: units, stops, missing marks, and which row is a frame's."""

import math

import camera_files as files
import pytest

from lensfit.errors import CameraError
from lensfit.io.camera.makers import (
    read_arri,
    read_blackmagic,
    read_canon,
    read_red_frames,
    read_red_static,
    read_sony,
)
from lensfit.io.camera.quantity import stop, stop_of_linear_iris
from lensfit.io.camera.read_camera_file import read_camera_file
from lensfit.io.camera.table import FrameKey, plain_timecode


def values(table, number=None, timecode=None, first=None):
    readings, _ = table.at(FrameKey(number, timecode), first)
    return {name: reading.value for name, reading in readings.items()}


def test_arri(tmp_path):
    found = values(read_arri(files.arri(tmp_path)))
    # 4448 photosites of 8.25 um, not the 316.8 mm that is to be found elsewhere.
    assert found.pop("t_number") == pytest.approx(1.782, abs=5e-4)
    assert found == {
        "focal_length_mm": 40.0,
        "focus_distance_mm": 2000.0,
        "sensor_width_mm": pytest.approx(36.70, abs=0.01),
        "camera_model": "Alexa LF",
        "lens_model": "SP40",
    }


@pytest.mark.parametrize("mark", ["--", "n.a.", "", "0.000"])
def test_what_arri_does_not_know_is_missing(tmp_path, mark):
    row = {"Lens Focus Distance": mark, "Lens Linear Iris": "--", "Lens Iris": "--"}
    found = values(read_arri(files.arri(tmp_path, row)))
    assert not {"focus_distance_mm", "t_number"} & found.keys()


@pytest.mark.parametrize(
    ("unit", "distance_mm"),
    [("Meter", 10_000), ("Feet", 3048), ("Inch", 254), ("cm", 100)],
)
def test_arri_distances_have_a_unit(tmp_path, unit, distance_mm):
    row = {"Lens Distance Unit": unit, "Lens Focus Distance": "10"}
    found = values(read_arri(files.arri(tmp_path, row)))
    assert found["focus_distance_mm"] == pytest.approx(distance_mm)


@pytest.mark.parametrize("unit", ["Furlong", "--"])
def test_an_unknown_unit_is_refused(tmp_path, unit):
    path = files.arri(tmp_path, {"Lens Distance Unit": unit})
    with pytest.raises(CameraError, match=r"arri.csv: line 2: Lens Distance Unit"):
        read_arri(path)


def test_the_second_timecode_stands_in_for_the_first(tmp_path):
    path = files.arri(tmp_path, {}, {})
    lines = path.read_text().split("\n")
    cells = lines[1].split("\t")
    cells[1] = "--"
    path.write_text("\n".join([lines[0], "\t".join(cells), lines[2], ""]))
    assert values(read_arri(path), timecode="10:00:00:00")["focus_distance_mm"] == 2000


def test_stops_close_by_the_root_of_two():
    assert stop("1.4 + 7/10", "x") == (None, pytest.approx(1.4 * 2**0.35))
    assert stop("T 2 3/10", "x") == ("T", pytest.approx(2 * 2**0.15))
    assert stop("F5.6", "x") == ("F", 5.6)
    assert stop("2 10/10", "x")[1] == pytest.approx(2 * math.sqrt(2))
    assert stop_of_linear_iris(1000) == 1.0
    assert stop_of_linear_iris(3000) == pytest.approx(2.0)
    # The label is rounded to a tenth of a stop, the linear iris is not.
    assert stop_of_linear_iris(2667) == pytest.approx(
        stop("1.4 + 7/10", "")[1], rel=0.02
    )


@pytest.mark.parametrize("text", ["wide", "T", "2 3/0", "--2", "2 + + 3/10", "9" * 99])
def test_what_is_no_stop(text):
    with pytest.raises(CameraError, match="stop"):
        stop(text, "Lens Iris")


def test_red_counts_millimetres_and_tells_t_stops_by_the_lens(tmp_path):
    found = values(read_red_frames(files.red_frames(tmp_path, 410)))
    assert found == {
        "focal_length_mm": 40.0,
        "focus_distance_mm": 410.0,
        "t_number": 5.6,
    }
    bare = values(read_red_frames(files.red_frames(tmp_path, 410, cooke="")))
    assert (bare["f_number"], "t_number" in bare) == (5.6, False)


def test_red_static_knows_the_sensor_and_no_focus(tmp_path):
    table = read_red_static(files.red_static(tmp_path))
    assert values(table, 7) == {
        "sensor_width_mm": pytest.approx(40.96),
        "sensor_height_mm": pytest.approx(21.6),
        "camera_model": "RANGER",
        "lens_model": "40mm T1.5",
    }
    assert "table of frames" in table.notes[0]
    unknown = read_red_static(files.red_static(tmp_path, sensor="NEW 12K"))
    assert "sensor_width_mm" not in values(unknown)


def test_sony_counts_feet(tmp_path):
    found = values(read_sony(files.sony(tmp_path)))
    assert found["focus_distance_mm"] == pytest.approx(3048)
    assert found["t_number"] == pytest.approx(2.219, abs=1e-3)
    assert values(read_sony(files.sony(tmp_path, "F 2.8")))["f_number"] == 2.8


def test_canon_bits_and_fractions(tmp_path):
    table = read_canon(files.canon(tmp_path))
    assert values(table) == {
        "focal_length_mm": 18.0,
        "t_number": 4.5,
        "focus_distance_mm": 500.0,
    }
    assert "taken as metres" in table.notes[0]
    far = values(read_canon(files.canon(tmp_path, math.inf, mode=1)))
    assert (far["focus_distance_mm"], far["f_number"]) == (math.inf, 4.5)
    unknown = values(read_canon(files.canon(tmp_path, math.nan, stop="65535/65535")))
    assert unknown == {"focal_length_mm": 18.0}


@pytest.mark.parametrize("stop_text", ["1/0", "1/2/3", "wide"])
def test_canon_fractions_that_are_none(tmp_path, stop_text):
    with pytest.raises(CameraError, match=r"line 2: ApertureNumber"):
        read_canon(files.canon(tmp_path, stop=stop_text))


def test_blackmagic(tmp_path):
    table = read_blackmagic(files.blackmagic(tmp_path, "991mm", "3.5m", "inf"))
    assert values(table, 1001, first=1001) == {
        "lens_model": "Cooke 50mm",
        "t_number": 2.3,
        "focal_length_mm": 50.0,
        "focus_distance_mm": 991.0,
    }
    assert values(table, 1002, first=1001)["focus_distance_mm"] == 3500
    assert values(table, 1003, first=1001)["focus_distance_mm"] == math.inf


def test_rows_belong_to_frames_by_timecode_or_by_counting(tmp_path):
    table = read_arri(files.arri(tmp_path, {}, {}, {}))
    assert values(table, 55, "10:00:00:02")["focus_distance_mm"] == 4000
    assert values(table, 1002, first=1001)["focus_distance_mm"] == 3000
    # Who counts means it, whatever the timecode.
    assert values(table, 1001, "10:00:00:02", 1001)["focus_distance_mm"] == 2000


@pytest.mark.parametrize(
    ("key", "first", "said"),
    [
        (FrameKey(1001), None, "the plate has no timecode"),
        (FrameKey(1001, "11:00:00:00"), None, "no row of timecode 11:00:00:00"),
        (FrameKey(1004), 1001, "frames 1001 to 1003 and none for 1004"),
        (FrameKey(1000), 1001, "none for 1000"),
        (FrameKey(), 1001, "no frame number"),
    ],
)
def test_a_frame_that_is_not_in_the_table_is_told(tmp_path, key, first, said):
    table = read_arri(files.arri(tmp_path, {}, {}, {}))
    with pytest.raises(CameraError, match=said):
        table.at(key, first)


def test_rows_that_say_the_same_need_no_match(tmp_path):
    still = {"Lens Focus Distance": "2.0"}
    table = read_arri(files.arri(tmp_path, still, still))
    assert values(table, 1001)["focus_distance_mm"] == 2000
    # The same timecode twice, as at high speed, is fine as long as nothing moves.
    twice = {"Master TC": "10:00:00:00"}
    table = read_arri(files.arri(tmp_path, twice, twice))
    with pytest.raises(CameraError, match="2 rows of timecode"):
        table.at(FrameKey(1, "10:00:00:00"), None)


@pytest.mark.parametrize("text", ["1:02:03;04", "01:02:03:04", " 01.02.03.04 "])
def test_timecodes_are_spelt_one_way(text):
    assert plain_timecode(text) == "01:02:03:04"


def test_no_timecode():
    assert plain_timecode("tomorrow") is None
    assert plain_timecode(7) is None


def test_the_kind_is_told_by_the_content(tmp_path):
    made = [
        files.arri(tmp_path),
        files.red_frames(tmp_path),
        files.red_static(tmp_path),
        files.sony(tmp_path),
        files.canon(tmp_path),
        files.blackmagic(tmp_path),
    ]
    kinds = [read_camera_file(path).kind for path in made]
    assert len(set(kinds)) == len(made)
    assert kinds[0] == "ARRI table"


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("none.csv", None, "cannot be read"),
        ("empty.csv", b"", "no camera file"),
        ("other.csv", b"a,b\n1,2\n", 'no camera file.*"Lens Distance Unit", .* tells'),
        ("binary.csv", bytes(range(256)) * 9, "no camera file"),
        ("utf16.csv", "Lens Linear Iris\t1\n".encode("utf-16"), "no camera file"),
        ("latin.csv", b"FrameNo,Focus Distance\n1,\xe9\n", "not text in UTF-8"),
        ("nul.csv", b"FrameNo,Focus Distance\n1,\0\n", "NUL"),
        ("header.csv", b"FrameNo,Focus Distance\n", "without rows"),
        ("quote.csv", b'FrameNo,Focus Distance\n1,"' + b"a" * 99999, "no row"),
        ("nan.csv", b"FrameNo,Focus Distance\n1,nan\n", "line 2: Focus Distance is"),
        ("minus.csv", b"FrameNo,Focus Distance\n1,-4\n", "line 2: Focus Distance is"),
        ("word.csv", b"FrameNo,Focus Distance\n1,near\n", "should be a number"),
        ("huge.csv", b"FrameNo,Focus Distance,Focal Length\n1,2,1e300\n", "focal le"),
        ("wide.csv", b"FrameNo,Focus Distance" + b",x" * 10**6, "4096 columns"),
        ("a.chan", b"1001 0 0 0 0 0 0\n", "7 numbers"),
        ("a.chan", b"1001 0 0 0 0 0 0 200\n", "vfov is 200"),
        ("a.chan", b"1.5 0 0 0 0 0 0 30\n", "no frame"),
        ("a.chan", b"1 0 0 0 0 0 0 30\n" * 2, "stands twice"),
        ("a.chan", b"1 " * 99_999, "longer than any"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path, name, data, said):
    path = tmp_path / name
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(CameraError, match=said) as caught:
        read_camera_file(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_more_rows_than_any_clip_has_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("lensfit.io.camera.table.MOST_ROWS", 3)
    read_red_frames(files.red_frames(tmp_path, 1, 2, 3))
    with pytest.raises(CameraError, match="more than 3 rows"):
        read_red_frames(files.red_frames(tmp_path, 1, 2, 3, 4))


def test_no_folder_and_no_device_is_read(tmp_path):
    for path in (tmp_path, "/dev/zero"):
        with pytest.raises(CameraError):
            read_camera_file(path)

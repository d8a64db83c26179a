"""Camera reports: every layout, rows by name and by time, and what is none."""

from datetime import datetime
from pathlib import Path

import pytest

from lensfit.errors import CameraError
from lensfit.io.camera.slates import read_slates, slate_of, time_of

CSV = """File Name,Lens,T-Stop,Focus,Focal Length
A001.exr,Prime 35,T2.8,4'11",35
grids/B002.tif,Prime 35,T4,1.5 m,35mm

C003,,,n/a,50
"""
TAB = CSV.replace(",", "\t")
SEMICOLON = CSV.replace(",", ";")
QUOTED = 'File Name,T-Stop,Focus\n"A001.exr","T2.8","4\'11"""\n'
ALE = """Heading
FIELD_DELIM\tTABS
FPS\t24

Column
Name\tT-stop\tFocus Distance

Data
A001\tT2.8\t4'11"
"""
TIMED = """time,f-stop
2026-05-01 10:00:00,2.8
2026-05-01 10:05:30,5.6
"""


def written(folder: Path, text: str, name: str = "report.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("text", [CSV, TAB, SEMICOLON, QUOTED, ALE])
def test_every_layout_says_the_same(tmp_path, text):
    slate = slate_of(read_slates(written(tmp_path, text)), Path("x/A001.exr"), None)
    assert slate is not None
    assert slate.values["t_number"] == "T2.8"
    assert slate.values["focus_distance_mm"] == "4'11\""


def test_rows_go_by_the_name_without_folder_and_ending(tmp_path):
    slates = read_slates(written(tmp_path, CSV))
    second = slate_of(slates, Path("other/b002.dng"), None)
    assert second is not None
    assert second.values["focus_distance_mm"] == "1.5 m"
    assert second.place == "report.csv line 3"
    third = slate_of(slates, Path("C003.png"), None)
    assert third is not None
    assert third.values == {"focal_length_mm": "50"}
    assert slate_of(slates, Path("D004.png"), None) is None


def test_rows_go_by_the_nearest_time(tmp_path):
    slates = read_slates(written(tmp_path, TIMED))
    for time, stop in (("10:00:40", "2.8"), ("10:05:00", "5.6")):
        slate = slate_of(slates, Path("a.jpg"), f"2026:05:01 {time}")
        assert slate is not None
        assert slate.values["f_number"] == stop
    assert slate_of(slates, Path("a.jpg"), "2026:05:01 12:00:00") is None
    assert slate_of(slates, Path("a.jpg"), None) is None


def test_two_rows_of_one_photograph_must_agree(tmp_path):
    rows = "File Name,T-Stop\nA001.exr,2.8\nroll/A001.dng,2.8\n"
    assert slate_of(read_slates(written(tmp_path, rows)), Path("A001.exr"), None)
    rows += "A001.tif,4\n"
    slates = read_slates(written(tmp_path, rows))
    with pytest.raises(CameraError, match=r"line 2 and report\.csv line 4 are both"):
        slate_of(slates, Path("A001.exr"), None)


def test_dates_of_exif_and_of_people():
    moment = datetime(2026, 5, 1, 10, 0)
    for text in ("2026:05:01 10:00:00", "2026-05-01T10:00:00Z", "01.05.2026 10:00"):
        assert time_of(text) == moment
    assert time_of("yesterday") is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no rows"),
        ("File Name,Lens\n", "no rows"),
        ("Lens,T-Stop\nPrime,2.8\n", "no column of file names or times"),
        ("File,Colour\na,blue\n", "no column of lens settings"),
    ],
)
def test_what_is_no_report_is_one_line(tmp_path, text, words):
    with pytest.raises(CameraError, match=words) as caught:
        read_slates(written(tmp_path, text))
    assert "report.csv" in str(caught.value)


def test_bytes_that_are_no_text(tmp_path):
    path = tmp_path / "report.csv"
    path.write_bytes(b"\xff\xfe\x00\x80" * 9)
    with pytest.raises(CameraError):
        read_slates(path)

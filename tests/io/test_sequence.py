"""Frame patterns find what exists, name what is missing, and never eat a source."""

from pathlib import Path

import pytest

from lensfit.errors import ImageError, OutputError
from lensfit.io.sequence import (
    expand_frames,
    format_frames,
    frame_path,
    output_path,
    parse_frames,
    split_pattern,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in (8, 9, 10, 12, 10001):
        (tmp_path / f"PLATE.{number:04d}.exr").touch()
    for distraction in ("PLATE.9.exr", "PLATE.00010.exr", "PLATE.x.exr", "A.0008.exr"):
        (tmp_path / distraction).touch()
    (tmp_path / "PLATE.0011.exr").mkdir()
    return tmp_path


@pytest.mark.parametrize("token", ["####", "@@@@", "%04d", "$F4"])
def test_existing_frames_in_order(folder: Path, token: str):
    pictures = expand_frames(folder / f"PLATE.{token}.exr")
    assert [number for number, _ in pictures] == [8, 9, 10, 12, 10001]
    assert [path.name for _, path in pictures][-2:] == [
        "PLATE.0012.exr",
        "PLATE.10001.exr",
    ]


@pytest.mark.parametrize("token", ["#", "%d", "@", "$F"])
def test_unpadded_numbers(folder: Path, token: str):
    pictures = expand_frames(folder / f"PLATE.{token}.exr")
    assert [(n, p.name) for n, p in pictures] == [
        (9, "PLATE.9.exr"),
        (10001, "PLATE.10001.exr"),
    ]


def test_chosen_frames_and_missing_ones(folder: Path):
    pattern = str(folder / "PLATE.####.exr")
    assert [n for n, _ in expand_frames(pattern, "8-12x2")] == [8, 10, 12]
    assert [n for n, _ in expand_frames(pattern, [12, 8])] == [12, 8]
    with pytest.raises(ImageError, match=r"4 of 8 frames are missing: 7,11,13-14"):
        expand_frames(pattern, "7-14")


@pytest.mark.parametrize(
    ("name", "without", "frames"),
    [
        ("a.1-9####.exr", "a.####.exr", "1-9"),
        ("a.-3--1x2,7@@@.exr", "a.@@@.exr", "-3--1x2,7"),
        ("a_8-12%04d.exr", "a_%04d.exr", "8-12"),
        ("a.1001,1003$F4.exr", "a.$F4.exr", "1001,1003"),
        ("shot2.####.exr", "shot2.####.exr", None),
        ("v2####.exr", "v2####.exr", None),
        ("1-2.exr", "1-2.exr", None),
    ],
)
def test_a_pattern_may_bring_its_range(name, without, frames):
    assert split_pattern(f"dir/{name}") == (Path("dir") / without, frames)


def test_frames_of_the_pattern_are_found_and_those_given_count_more(folder: Path):
    pattern = folder / "PLATE.8-9####.exr"
    assert [n for n, _ in expand_frames(pattern)] == [8, 9]
    assert [n for n, _ in expand_frames(pattern, "12")] == [12]


def test_single_pictures(folder: Path):
    path = folder / "A.0008.exr"
    assert expand_frames(path) == [(None, path)]
    with pytest.raises(ImageError, match="single picture"):
        expand_frames(path, "1-2")
    with pytest.raises(ImageError, match="does not exist; check its path"):
        expand_frames(folder / "B.exr")
    with pytest.raises(ImageError, match=r"is a folder; .* plate.####.exr"):
        expand_frames(folder)


def test_nothing_there_is_said(tmp_path: Path):
    for pattern in ("none.####.exr", "no/folder/a.####.exr"):
        with pytest.raises(ImageError, match="no frame exists; check the folder"):
            expand_frames(tmp_path / pattern)
    with pytest.raises(ImageError, match="more than one"):
        expand_frames("a.####.%04d.exr")


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("5", [5]),
        ("1-4", [1, 2, 3, 4]),
        ("1-10x4, 20", [1, 5, 9, 20]),
        ("-3--1,2", [-3, -2, -1, 2]),
        ("1-3,2-4", [1, 2, 3, 4]),
        ("5-1", [5, 4, 3, 2, 1]),
        ("5-1x2", [5, 3, 1]),
        ("5-1x-2", [5, 3, 1]),
        ("1-7y3", [2, 3, 5, 6]),
        ("1-9:4", [1, 5, 9, 3, 7, 2, 4, 6, 8]),
        ("-4--8x2", [-4, -6, -8]),
    ],
)
def test_ranges(text: str, numbers: list[int]):
    assert parse_frames(text) == numbers


@pytest.mark.parametrize(
    "text", ["", "a", "1-", "1-3z2", "1-3x0", "1-3y0", "1..3", "1-99999999999"]
)
def test_bad_ranges(text: str):
    with pytest.raises(ImageError, match="no range of frames"):
        parse_frames(text)


def test_short_form_and_back():
    numbers = [9, 1, 2, 3, 7, -4, -5]
    assert format_frames(numbers) == "-5--4,1-3,7,9"
    assert parse_frames(format_frames(numbers)) == sorted(numbers)


def test_frame_paths():
    assert frame_path("a/b.####.exr", 7) == Path("a/b.0007.exr")
    assert frame_path("a/b.%05d.exr", -7) == Path("a/b.-00007.exr")
    assert frame_path("a/b.exr", 7) == Path("a/b.exr")
    # A folder may look like a pattern; only the file name counts.
    assert frame_path("shot_###/b.@@.exr", 123) == Path("shot_###/b.123.exr")


def test_outputs_keep_their_name_and_never_replace_the_source(tmp_path: Path):
    source = tmp_path / "a.0001.exr"
    assert output_path(source, "out") == Path("out/a.0001.exr")
    with pytest.raises(OutputError, match="its own source"):
        output_path(source, tmp_path / "x" / "..")


@pytest.mark.parametrize("name", ["a#b.exr", "50%d.exr", "v####.exr"])
def test_a_picture_that_is_there_is_taken_by_its_name(tmp_path: Path, name: str):
    (tmp_path / name).touch()
    assert expand_frames(tmp_path / name) == [(None, tmp_path / name)]

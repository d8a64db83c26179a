"""Holes in a sequence, and frames of another size, are told once."""

import numpy as np
import pytest
from plate_makers import CAMERA, SENSOR, make_preset, sharp, write_plate

from lensfit.coords import Window
from lensfit.io.exr import ExrImage, ExrPart, write_exr
from lensfit.io.sequence import parse_frames
from lensfit.plate.farm.job import farm_job
from lensfit.plate.notes import gaps_note, sizes_note
from lensfit.workflow.apply import apply

ALL = {**CAMERA, **SENSOR}


@pytest.mark.parametrize(
    ("exist", "said"),
    [
        ("1-16,18-30", "frame 17 is missing between 1 and 30"),
        ("1-5,8,10-12", "frames 6-7,9 are missing between 1 and 12"),
        ("-2,2", "frames -1-1 are missing between -2 and 2"),
        ("1-99x2", "frames 1-99y2 are missing between 1 and 99"),
        ("1-10x3", "frames 1-10y3 are missing between 1 and 10"),
    ],
)
def test_missing_frames_are_a_range_that_can_be_read_again(exist, said):
    numbers = sorted(parse_frames(exist))
    note = gaps_note("seq.####.exr", numbers)
    assert note == f"seq.####.exr: {said}; --frames says which are wanted"
    missing = parse_frames(said.split()[1])
    every = range(numbers[0], numbers[-1] + 1)
    assert sorted([*missing, *numbers]) == list(every)


@pytest.mark.parametrize("numbers", [[], [7], [1, 2, 3], [-1, 0, 1]])
def test_a_whole_sequence_is_nothing_to_tell(numbers):
    assert gaps_note("p.#.exr", numbers) is None


def test_many_holes_and_a_far_frame_are_one_short_line():
    numbers = [n for n in range(1000) if n % 7 and n % 11]
    note = gaps_note("p.#.exr", [*numbers, 10**12])
    assert note is not None
    assert len(note) < 200
    assert "more ranges" in note


def test_frames_without_a_size_are_not_compared(tmp_path):
    a, b, c = (tmp_path / name for name in "abc")
    assert sizes_note([(a, None), (b, (4, 3)), (c, (4, 3))]) is None
    note = sizes_note([(a, None), (b, (4, 3)), (c, (3, 4))])
    assert note is not None
    assert note.startswith("c: the display window is 3 x 4 pixels, that of b 4 x 3;")


def _small_plate(path):
    window = Window.of_size(48, 32)
    pixels = {name: np.full((32, 48), 0.5, np.float32) for name in "RGB"}
    write_exr(path, ExrImage((ExrPart(pixels, window, window, dict(ALL)),)))


def test_a_run_tells_of_its_holes_and_of_another_size_once(tmp_path):
    for number in (1, 2, 4):
        write_plate(tmp_path / f"seq.{number:04d}.exr", ALL)
    _small_plate(tmp_path / "seq.0005.exr")
    pattern = tmp_path / "seq.####.exr"
    hole = f"{pattern}: frame 3 is missing between 1 and 5; --frames says which"
    size = "seq.0005.exr: the display window is 48 x 32 pixels, that of seq.0001.exr"
    for again in (False, True):  # the second time all frames are finished
        applied = apply(make_preset(), pattern, tmp_path / "out", options=sharp())
        assert len(applied.skipped if again else applied.written) == 4
        assert [n.startswith(hole) for n in applied.notes].count(True) == 1
        assert [n.startswith(size) for n in applied.notes].count(True) == 1
    chosen = apply(
        make_preset(), pattern, tmp_path / "out", frames="1,2,4", options=sharp()
    )
    assert not any("missing" in n or "display window" in n for n in chosen.notes)


def test_a_farm_is_told_of_the_holes_too(tmp_path):
    (tmp_path / "preset.json").touch()
    for number in (1, 2, 4):
        (tmp_path / f"p.{number}.exr").touch()
    words = (tmp_path / "preset.json", str(tmp_path / "p.#.exr"), tmp_path / "out")
    gaps = farm_job(*words).gaps
    assert gaps is not None
    assert "frame 3 is missing between 1 and 4" in gaps
    assert farm_job(*words, "1,2,4").gaps is None

"""Shoot files as crews write them: feet, inches, T-stops, marks, groups, defaults."""

import math
from pathlib import Path

import pytest

from lensfit.errors import ShootError
from lensfit.workflow.shoot.crew_notation import length_mm
from lensfit.workflow.shoot.shoot_file import load_shoot

CREW = """
[lens]
name = "Prime 35"
[camera]
sensor_width_mm = 24.0
[focus_marks]
close = "2'6\\""
mid = "4'11\\""
far = "inf"
[defaults]
focal_length_mm = 35
f_number = 2.8
[[group]]
name = "wide open"
f_number = 1.4
target_distance = "1.5 m"
[[target]]
name = "dots"
kind = "dot-grid"
pitch = "1 1/2 in"
hole_diameter_mm = 0.5
takes = { target_distance = "4 ft" }
[[target]]
name = "lines"
kind = "line-grid"
pitch = ["5 cm", "60 mm"]
"""


def shoot(tmp_path: Path, takes: str, head: str = CREW):
    path = tmp_path / "shoot.toml"
    path.write_text(head + takes, encoding="utf-8")
    return load_shoot(path)


def take(*lines: str, image: str = "a.exr", target: str = "dots") -> str:
    head = ["[[take]]", f'image = "{image}"', f'target = "{target}"']
    return "\n".join(head + list(lines)) + "\n"


@pytest.mark.parametrize(
    ("text", "mm"),
    [
        ("4'11\"", 59 * 25.4),
        ("4' 11 1/2\"", 59.5 * 25.4),
        ("4ft 11in", 59 * 25.4),
        ("4’11”", 59 * 25.4),
        ("4'", 48 * 25.4),
        ("2 feet", 24 * 25.4),
        ("59 in", 59 * 25.4),
        ('18 3/8"', 18.375 * 25.4),
        ("1.5 m", 1500),
        ("150cm", 1500),
        ("1500 mm", 1500),
        (".9 m", 900),
        ("inf", math.inf),
    ],
)
def test_lengths_of_the_tape_measure(text, mm):
    assert length_mm(text, "focus_distance", "here") == pytest.approx(mm, rel=1e-12)


@pytest.mark.parametrize(
    "text", ["", "1500", "4'12\"", "4'11", "-3 m", "3 yards", "1/0 in", "m", "5 m 3 cm"]
)
def test_what_is_no_length_is_one_line(text):
    if text == "4'11":
        assert length_mm(text, "k", "here") == pytest.approx(59 * 25.4)
        return
    with pytest.raises(ShootError, match="here") as caught:
        length_mm(text, "k", "here")
    assert "\n" not in str(caught.value)


def test_the_nearest_word_counts(tmp_path):
    takes = take(image="default.exr")
    takes += take('group = "wide open"', image="group.exr")
    takes += take('group = "wide open"', "f_number = 4", image="own.exr")
    takes += take(image="lines.exr", target="lines")
    default, group, own, lines = shoot(tmp_path, takes).takes
    assert [one.focal_length_mm for one in (default, group, own, lines)] == [35] * 4
    assert [one.f_number for one in (default, group, own, lines)] == [2.8, 1.4, 4, 2.8]
    assert default.target_distance_mm == pytest.approx(48 * 25.4)
    assert group.target_distance_mm == own.target_distance_mm == 1500
    assert lines.target_distance_mm is None


def test_pitches_and_marks(tmp_path):
    found = shoot(
        tmp_path,
        take('focus_mark = "mid"')
        + take('focus_mark = "far"', image="b.exr", target="lines"),
    )
    assert found.targets["dots"].pitch_mm == pytest.approx(38.1)
    assert found.targets["lines"].pitch_xy_mm == (50, 60)
    near, far = found.takes
    assert near.focus_distance_mm == pytest.approx(59 * 25.4)
    assert far.focus_distance_mm == math.inf


def test_a_t_stop_stands_for_the_f_number_and_is_said(tmp_path):
    found = shoot(tmp_path, take("t_number = 2.0"))
    assert found.takes[0].f_number == 2.0
    assert any("T-stops are used as f-numbers" in note for note in found.notes)
    for line in ('t_number = "2.0"', 't_number = "T2.0"', 'f_number = "T2"'):
        engraved = shoot(tmp_path, take(line))
        assert engraved.takes[0].f_number == 2.0
        assert any("T-stops are used as f-numbers" in note for note in engraved.notes)
    assert shoot(tmp_path, take('f_number = "f/2.8"')).takes[0].f_number == 2.8
    both = shoot(tmp_path, take("t_number = 2.0", "f_number = 1.9"))
    assert both.takes[0].f_number == 1.9
    assert not any("T-stop" in note for note in both.notes)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (('focus_distance = "5 foo"',), "no known unit"),
        (("focus_distance = 1500",), "names no unit"),
        (('focus_distance = "1 m"', "focus_distance_mm = 9"), "states both"),
        (('focus_mark = "clsoe"',), "did you mean"),
        (('focus_mark = "mid"', "focus_distance_mm = 900"), "states both"),
        (('group = "wide"',), "no group is named"),
        (('group = ["wide"]',), "no group is named"),
        (('focus_mark = ["mid"]',), "no focus mark is named"),
        (("focal_length = 28",), 'write focal_length = "28 mm"'),
        (("f_number = 1e-9",), "f_number"),
        (("t_stop = 4.5",), "t_number"),
        (("t_number = 0",), "t_number = 0 is none that a lens has"),
        (('f_number = "four"',), "f_number = four is none"),
        (("anamorphic_squeeze = 1e9",), "anamorphic_squeeze"),
        (("f_numbr = 2",), "f_numbr"),
    ],
)
def test_mistakes_name_their_take(tmp_path, lines, words):
    with pytest.raises(ShootError, match=r"\[\[take\]\] 1") as caught:
        shoot(tmp_path, take(*lines))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("head", "place"),
    [
        ("[defaults]\nf_numbr = 2\n", "defaults"),
        ('[defaults]\nimage = "a.exr"\n', "defaults"),
        ('[[group]]\nname = "a"\nf_numbr = 2\n', r"\[\[group\]\] 1"),
        ("[[group]]\nf_number = 2\n", r"\[\[group\]\] 1"),
        ("[focus_marks]\nmid = -3\n", "focus_marks"),
        ("defaults = 3\n", "defaults"),
        ('[group]\nname = "a"\n', r"write \[\[group\]\], with two brackets"),
        ('[defaults]\nname = "a"\n', "defaults"),
        ("[default]\nf_number = 2\n", 'did you mean "defaults"'),
    ],
)
def test_mistakes_of_what_is_shared_name_its_table(tmp_path, head, place):
    lens = '[lens]\nname = "x"\n[[target]]\nname = "dots"\nkind = "dot-grid"\n'
    lens += "pitch_mm = 9\n"
    text = head + lens if head.startswith("defaults =") else lens + head
    with pytest.raises(ShootError, match=place):
        shoot(tmp_path, take(), text)


@pytest.mark.parametrize("image", ["  ", "a\\u0000.exr"])
def test_a_name_that_no_file_has_is_refused(tmp_path, image):
    with pytest.raises(ShootError, match=r"\[\[take\]\] 1, image: is blank or has"):
        shoot(tmp_path, take(image=image))

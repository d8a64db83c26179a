"""Shoot files: what they say is read, and every mistake gets one line with its key."""

import math
from pathlib import Path

import pytest

from lensfit.errors import ShootError
from lensfit.workflow.shoot.shoot_file import load_shoot

GOOD = """
[lens]
name = "SMC Takumar 50/1.4"
serial = "1234567"
[camera]
sensor_width_mm = 24.89
sensor_height_mm = 18.6675
mosaic = "grbg"
[[target]]
name = "dots"
kind = "dot-grid"
pitch_mm = 37.5
hole_diameter_mm = 0.47
[[target]]
name = "lines"
kind = "line-grid"
pitch_mm = [56.25, 50]
[[take]]
image = "a.exr"
target = "dots"
focal_length_mm = 50
f_number = 1.4
focus_distance_mm = inf
[[take]]
image = "sub/b.png"
target = "lines"
roi = [10, 20, 300, 400]
encoding = "srgb"
"""


@pytest.fixture
def write(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "shoot.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_every_key_is_read(write):
    shoot = load_shoot(write(GOOD))
    assert shoot.lens.serial == "1234567"
    assert shoot.camera.sensor_height_mm == 18.6675
    assert shoot.camera.mosaic == "grbg"
    dots, lines = shoot.targets["dots"], shoot.targets["lines"]
    assert dots.pitch_xy_mm == (37.5, 37.5)
    assert lines.pitch_xy_mm == (56.25, 50.0)
    first, second = shoot.takes
    assert first.focus_distance_mm == math.inf
    assert second.f_number is None
    assert shoot.image_path(second) == shoot.path.parent / "sub" / "b.png"
    assert shoot.target_of(second) is lines
    assert shoot.notes == ()


def test_an_unused_target_is_noted_and_stops_nothing(write):
    shoot = load_shoot(write(GOOD.replace('target = "lines"', 'target = "dots"')))
    assert shoot.notes == ('target "lines" is in no take',)


def test_values_that_the_draft_left_to_check_are_named(write):
    text = GOOD.replace("pitch_mm = 37.5", "pitch_mm = 37.5  # ruler; TODO: measure")
    text = text.replace('name = "SMC Takumar 50/1.4"', 'name = "a # TODO"')
    text = text.replace('target = "lines"', 'target = "lines"  # TODO: which?')
    text = text.replace("[camera]", "[camera]\nmodel = 'X'  # TODO: as engraved")
    text += "# f_number = 2.8  # TODO: as on the barrel\n"
    (note,) = load_shoot(write(text)).notes
    assert "TODO: camera.model; [[target]] 1, pitch_mm; [[take]] 2, target." in note


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "f_number",
            "f_numbr",
            '[[take]] 1: unknown key "f_numbr"; did you mean',
        ),
        ("[camera]", "[kamera]", 'unknown key "kamera"; did you mean "camera"?'),
        ("pitch_mm = 37.5", "", '[[target]] 1: key "pitch_mm" is missing; add it'),
        (
            "37.5",
            '"37.5"',
            "[[target]] 1: pitch_mm = '37.5' is no length",
        ),
        (
            "37.5",
            "-37.5",
            "[[target]] 1, pitch_mm: expected a number of at least 0.001",
        ),
        (
            "37.5",
            "[37.5]",
            "[[target]] 1, pitch_mm: expected a list of length at least 2",
        ),
        ("37.5", "nan", "[[target]] 1, pitch_mm: nan is no finite number"),
        ("24.89", "inf", "camera.sensor_width_mm: inf is no finite number"),
        ("1.4\nfo", "0\nfo", "[[take]] 1: f_number = 0 is none that a lens has"),
        ("1.4\nfo", "true\nfo", "[[take]] 1: f_number = True is none that a lens has"),
        (
            '"dot-grid"',
            '"dots-grid"',
            '"dots-grid" is unknown; did you mean',
        ),
        (
            'target = "dots"',
            'target = "dotz"',
            'no target is named "dotz"; did',
        ),
        ('name = "lines"', 'name = "dots"', 'a second target is named "dots"'),
        ("sub/b.png", "./a.exr", "is the photograph of [[take]] 1 again"),
        ("300, 400", "5, 400", "roi = [10.0, 20.0, 5.0, 400.0] is no box"),
        ("[10, 20", "[-10, 20", "is no box inside the image"),
        ("0.47", "40", "hole_diameter_mm = 40 is not smaller than pitch_mm = 37.5"),
        (
            "hole_diameter_mm",
            "line_width_mm",
            "line_width_mm has no meaning for",
        ),
        (
            "= inf",
            "= 2.0",
            "focus_distance_mm = 2 is not beyond the focal length",
        ),
        (
            "focal_length_mm = 50",
            "focal_length_mm = 0.05",
            "focal_length_mm = 0.05 is too short for a sensor of sensor_width_mm = "
            "24.89; both are in millimetres",
        ),
        ("24.89", "0.02489", "focal_length_mm = 50 is too long for a sensor"),
        ("= inf", "= -inf", "[[take]] 1, focus_distance_mm: -inf is no finite number"),
        ('"dot-grid"', '"charuco"', "hole_diameter_mm has no meaning for a charuco"),
        ('"line-grid"', '"charuco"', 'a charuco needs "squares"; add it'),
        ("[lens]", "[lens", "is not valid TOML"),
        (
            '"grbg"',
            '"rggg"',
            'camera.mosaic: "rggg" is unknown; did you mean "rggb"?',
        ),
        ('"srgb"', '"sRGBB"', 'encoding "sRGBB" is unknown; did you mean "srgb"?'),
    ],
)
def test_each_mistake_gets_one_line(write, old: str, new: str, said: str):
    assert old in GOOD
    path = write(GOOD.replace(old, new, 1))
    with pytest.raises(ShootError) as caught:
        load_shoot(path)
    line = str(caught.value)
    assert line.startswith(str(path))
    assert said in line
    assert "\n" not in line
    assert "`" not in line


def test_a_syntax_error_names_its_line(write):
    with pytest.raises(ShootError, match=r"at line 2, column 17"):
        load_shoot(write('[lens]\nname = "unclosed\n'))


def test_a_file_that_is_not_there_or_not_text(tmp_path: Path):
    with pytest.raises(ShootError, match=r"cannot be read \(No such file"):
        load_shoot(tmp_path / "none.toml")
    with pytest.raises(ShootError, match="is no ordinary file"):
        load_shoot(tmp_path)
    (tmp_path / "picture.toml").write_bytes(b"\xff\xd8\xff\xe0\x00")
    with pytest.raises(ShootError, match="is not text"):
        load_shoot(tmp_path / "picture.toml")


def test_no_take_is_no_shoot(write):
    with pytest.raises(ShootError, match="take"):
        load_shoot(write(GOOD[: GOOD.index("[[take]]")]))

"""Keys of a TOML file set line by line: what else it says stays as it is."""

import tomllib

import pytest

from lensfit.workflow.shoot.toml_lines import (
    toml_value,
    with_keys,
    with_table,
    without_table,
)

TEXT = """\
# a shoot
[lens]
name = "A # lens"  # as engraved

[[take]]
image = "a.exr"
f_number = 2.8  # TODO: as on the barrel

[[take]]  # the second
image = "b.exr"  # blurred
"""


def test_a_value_is_set_and_its_comment_stays():
    text = with_keys(TEXT, "lens", {"name": 'B "two"'})
    assert text == TEXT.replace('"A # lens"', '"B \\"two\\""')


def test_a_todo_goes_with_what_it_asked():
    text = with_keys(TEXT, "take", {"f_number": 4.0}, 0)
    assert text == TEXT.replace("2.8  # TODO: as on the barrel", "4.0")


def test_a_key_is_added_to_the_table_that_is_meant_and_taken_away():
    text = with_keys(TEXT, "take", {"roi": [1, 2, 3, 4]}, 1)
    assert text is not None
    assert tomllib.loads(text)["take"][1]["roi"] == [1, 2, 3, 4]
    assert with_keys(text, "take", {"roi": None}, 1) == TEXT
    assert with_keys(TEXT, "take", {"roi": None}, 1) == TEXT


def test_tables_come_and_go():
    text = with_table(TEXT, "take", '[[take]]\nimage = "c.exr"\n')
    assert text is not None
    assert len(tomllib.loads(text)["take"]) == 3
    assert without_table(text, "take", 2) == TEXT + "\n"
    first = without_table(TEXT, "take", 0)
    assert first is not None
    assert tomllib.loads(first)["take"] == [{"image": "b.exr"}]
    assert "# the second" in first
    assert with_keys("", "camera", {"model": "X"}) == '[camera]\nmodel = "X"\n'


@pytest.mark.parametrize(
    "text",
    ['lens = {name = "A"}\n', '[lens]\nname = """\nA"""\n', 'lens.name = "A"\n'],
)
def test_what_is_not_understood_is_left_alone(text: str):
    assert with_keys(text, "lens", {"name": "B"}) is None


def test_a_place_that_is_not_there_is_none():
    assert with_keys(TEXT, "take", {"f_number": 2}, 2) is None
    assert without_table(TEXT, "take", 5) is None
    assert without_table(TEXT, "target", 0) is None


@pytest.mark.parametrize("value", [True, 1.5, float("inf"), "é\n\x7f", [1, "a"], -3])
def test_values_are_read_back(value: object):
    assert tomllib.loads(f"x = {toml_value(value)}")["x"] == value

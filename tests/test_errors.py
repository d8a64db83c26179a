"""A failure is one line that a terminal can show, whatever a file holds."""

import pytest

from lensfit.errors import ImageError


def test_a_line_says_what_where_and_what_to_do():
    error = ImageError("is empty", where="a.exr", remedy="copy it again")
    assert str(error) == "a.exr: is empty; copy it again"
    assert str(ImageError("is 3 µm × 2 → é")) == "is 3 µm × 2 → é"


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("two\nlines\r\n", "two lines"),
        ("a\u2028b\x85c\x1dd", "a b c d"),
        ("\x1b[31mred", r"\x1b[31mred"),
        ("a\0b", r"a\x00b"),
        ("half \ud800", r"half \ud800"),
        ("\u202egpj.exe", r"\u202egpj.exe"),
    ],
)
def test_what_is_no_text_is_spelt(said: str, shown: str):
    assert str(ImageError(said)) == shown
    assert str(ImageError("is bad", remedy=said)) == f"is bad; {shown}"


def test_endless_words_are_cut_and_the_rest_is_not():
    error = ImageError("w" * 10**6, where="p" * 900, remedy="r" * 10**6)
    assert len(str(error)) < 2000
    assert str(error).startswith("p" * 900 + ": w")
    assert "r" * 100 in str(error)

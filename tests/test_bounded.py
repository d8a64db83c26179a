"""What is no ordinary file, too large or no text is one error line."""

import os
import re
from pathlib import Path

import pytest

from lensfit.bounded import read_beginning, read_bounded, utf8_text
from lensfit.errors import CameraError


def test_a_file_of_the_largest_size_is_read_whole(tmp_path: Path):
    path = tmp_path / "a"
    path.write_bytes(b"x" * 10)
    assert read_bounded(path, 10, error=CameraError) == b"x" * 10
    with pytest.raises(CameraError, match=r"larger than .*; cut it"):
        read_bounded(path, 9, error=CameraError, remedy="mend", too_large="cut it")


def test_of_a_large_file_only_the_beginning_is_read(tmp_path: Path):
    path = tmp_path / "a"
    with path.open("wb") as file:
        file.truncate(2**40)
    assert read_beginning(path, 3, error=CameraError) == b"\0\0\0"


def test_a_pipe_to_which_nobody_writes_is_not_waited_for(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, Path("/dev/zero")):
        with pytest.raises(CameraError, match=r"no ordinary file; give one"):
            read_bounded(path, 10, error=CameraError, remedy="give one")


@pytest.mark.parametrize("name", ["none", "a\0b", "a" * 5000])
def test_what_is_not_there_cannot_be_read(tmp_path: Path, name: str):
    with pytest.raises(CameraError, match=r"cannot be read .*give one") as caught:
        read_bounded(tmp_path / name, 10, error=CameraError, remedy="give one")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [("é".encode("latin-1"), "UTF-8 (byte 0)"), (b"a\0", "NUL bytes")],
)
def test_what_is_no_text_is_refused(content: bytes, says: str):
    with pytest.raises(CameraError, match=re.escape(says)):
        utf8_text(content, Path("a"), error=CameraError)


def test_a_byte_order_mark_is_no_text():
    marked = b"\xef\xbb\xbfe"
    assert utf8_text(marked, Path("a"), error=CameraError) == "e"

"""Outputs are whole or not there, whatever stops the writer."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from lensfit.atomic import (
    atomic_path,
    remove_abandoned,
    write_bytes_atomic,
    write_folder_summary,
    write_text_atomic,
)
from lensfit.errors import OutputError


def test_the_result_appears_in_a_new_folder_and_nothing_else(tmp_path: Path):
    target = tmp_path / "new" / "deep" / "a.json"
    write_text_atomic(target, "é\n")
    assert target.read_bytes() == "é\n".encode()
    assert os.listdir(target.parent) == ["a.json"]


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_writer_that_stops_leaves_the_old_file(tmp_path: Path, stop: type):
    target = tmp_path / "map.exr"
    write_bytes_atomic(target, b"old")

    def write_half() -> None:
        with atomic_path(target) as temporary:
            assert temporary.parent == target.parent
            assert temporary.suffix == ".exr"
            temporary.write_bytes(b"half")
            raise stop

    with pytest.raises(stop):
        write_half()
    assert target.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["map.exr"]


def test_permissions_follow_the_umask(tmp_path: Path):
    before = os.umask(0o027)
    try:
        write_bytes_atomic(tmp_path / "a", b"")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o640


def test_what_is_in_the_way_is_said(tmp_path: Path):
    with pytest.raises(OutputError, match="a folder of that name is in the way"):
        write_text_atomic(tmp_path, "")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is a file; give a folder"):
        write_text_atomic(tmp_path / "file" / "a", "")


def test_only_what_dead_processes_left_is_removed(tmp_path: Path):
    target = tmp_path / "a.exr"
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    with atomic_path(target) as mine:
        dead = mine.with_name(mine.name.replace(f"-{os.getpid()}.", f"-{ended.pid}."))
        other = dead.with_name(dead.name.replace(".a.", ".b."))
        dead.touch()
        other.touch()
        (tmp_path / ".a.exr").touch()
        remove_abandoned(target)
        assert mine.exists()
        assert not dead.exists()
        assert other.exists()
        assert (tmp_path / ".a.exr").exists()
    remove_abandoned(tmp_path / "no" / "folder.exr")


@pytest.mark.parametrize("below", ["a.exr", "b/a.exr"])
def test_a_file_in_place_of_a_folder_is_named(tmp_path, below):
    (tmp_path / "out").touch()
    with pytest.raises(OutputError) as caught:
        write_text_atomic(tmp_path / "out" / below, "text")
    assert str(caught.value) == f"{tmp_path / 'out'}: is a file; give a folder"


def test_a_summary_holds_what_another_process_added_while_it_was_written(tmp_path):
    """The other one looked, added its file and wrote before this one's text landed."""
    target = tmp_path / "all.txt"

    def names() -> str:
        return " ".join(sorted(p.name for p in tmp_path.glob("frame*")))

    def seen_too_early() -> str:
        seen = names()
        if "frame2" not in seen:
            (tmp_path / "frame2").touch()
            write_folder_summary(target, names)
            assert target.read_text() == "frame1 frame2"
        return seen

    (tmp_path / "frame1").touch()
    write_folder_summary(target, seen_too_early)
    assert target.read_text() == "frame1 frame2"

"""Outputs of one run appear together, whatever stops the run."""

import errno
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from lensfit import atomic_set as module
from lensfit.atomic_set import atomic_output_set
from lensfit.errors import OutputError


def write(folder: Path, **texts: str) -> None:
    """Files, by their stem; "maps__a" lies in a subfolder."""
    for name, text in texts.items():
        path = folder / f"{name.replace('__', '/')}.txt"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)


def contents(folder: Path) -> dict[str, str]:
    found = [path for path in folder.rglob("*") if path.is_file()]
    return {p.relative_to(folder).as_posix(): p.read_text() for p in found}


@pytest.fixture
def one_by_one(monkeypatch):
    """A system that cannot exchange folders."""
    monkeypatch.setattr(module, "exchange_folder", lambda *_: False)


def test_nothing_is_there_before_the_end(tmp_path):
    write(tmp_path, report="old", other="of the user")
    with atomic_output_set(tmp_path) as made:
        write(made, report="new", maps__a="new")
        assert contents(tmp_path)["report.txt"] == "old"
        assert not (tmp_path / "maps").exists()
    assert contents(tmp_path) == {
        "report.txt": "new",
        "maps/a.txt": "new",
        "other.txt": "of the user",
    }
    assert sorted(os.listdir(tmp_path)) == ["maps", "other.txt", "report.txt"]


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_run_that_stops_changes_nothing(tmp_path, stop):
    old, fresh = tmp_path / "old", tmp_path / "fresh"
    old.mkdir()
    write(old, report="old", maps__a="old")

    def stopped(folder: Path) -> None:
        with atomic_output_set(folder, replaces=[Path("maps/a.txt")]) as made:
            write(made, report="new", maps__b="new")
            raise stop

    for folder in (old, fresh):
        with pytest.raises(stop):
            stopped(folder)
    assert contents(old) == {"report.txt": "old", "maps/a.txt": "old"}
    assert os.listdir(tmp_path) == ["old"]


@pytest.mark.usefixtures("one_by_one")
def test_an_interrupt_waits_for_the_moves(tmp_path, monkeypatch):
    move = module._move

    def interrupted_move(made: Path, path: Path) -> None:
        if path.name == "a.txt":
            os.kill(os.getpid(), signal.SIGINT)
        move(made, path)

    def run() -> None:
        with atomic_output_set(tmp_path, replaces=[Path("old.txt")]) as made:
            write(made, a="new", b="new", maps__c="new")

    write(tmp_path, old="old")
    monkeypatch.setattr(module, "_move", interrupted_move)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            run()
    finally:
        signal.signal(signal.SIGINT, before)
    assert sorted(contents(tmp_path)) == ["a.txt", "b.txt", "maps/c.txt"]
    assert sorted(os.listdir(tmp_path)) == ["a.txt", "b.txt", "maps"]


@pytest.mark.usefixtures("one_by_one")
def test_the_last_names_are_given_last(tmp_path, monkeypatch):
    moved, move = [], module._move

    def noted_move(made: Path, path: Path) -> None:
        moved.append(path.name)
        move(made, path)

    monkeypatch.setattr(module, "_move", noted_move)
    with atomic_output_set(tmp_path, last=("b.txt", "never.txt", "a.txt")) as made:
        write(made, a="", b="", c="", maps__d="")
    assert moved == ["c.txt", "d.txt", "b.txt", "a.txt"]


def test_what_is_not_written_again_is_removed_and_nothing_else(tmp_path):
    write(tmp_path, maps__a="old", maps__b="old", maps__mine="mine", blur__a="old")
    earlier = [Path(name) for name in ("maps/A.txt", "maps/b.txt", "blur/a.txt")]
    with atomic_output_set(tmp_path, replaces=[*earlier, Path("gone/a.txt")]) as made:
        write(made, maps__a="new")
    assert contents(tmp_path) == {"maps/a.txt": "new", "maps/mine.txt": "mine"}
    assert os.listdir(tmp_path) == ["maps"]


@pytest.mark.usefixtures("one_by_one")
def test_a_subfolder_may_be_a_link_to_another_disk(tmp_path, monkeypatch):
    replace = os.replace

    def within_a_folder(source, target) -> None:
        if Path(source).parent != Path(target).parent:
            raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))
        replace(source, target)

    monkeypatch.setattr(os, "replace", within_a_folder)
    with atomic_output_set(tmp_path) as made:
        write(made, maps__a="new")
    assert contents(tmp_path) == {"maps/a.txt": "new"}


def test_what_is_in_the_way_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="is a file; give a folder"):
        atomic_output_set(tmp_path / "file").__enter__()
    (tmp_path / "a.txt").mkdir()

    def run() -> None:
        with atomic_output_set(tmp_path) as made:
            write(made, a="new")

    with pytest.raises(OutputError, match=r"a\.txt: cannot be written"):
        run()


def test_the_hidden_folder_of_a_killed_run_is_removed(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    with atomic_output_set(tmp_path) as mine:
        dead = mine.with_name(mine.name.replace(f"-{os.getpid()}.", f"-{ended.pid}."))
        dead.mkdir()
        write(dead, maps__a="half")
        with atomic_output_set(tmp_path) as another:
            assert not dead.exists()
            assert mine.exists()
            write(another, a="new")
    assert contents(tmp_path) == {"a.txt": "new"}


KILLED = """
import os, signal, sys
from pathlib import Path
from lensfit import swapped_folder
from lensfit.atomic_set import atomic_output_set

folder, last = Path(sys.argv[1]), int(sys.argv[2])
calls = 0


def dying(function):
    def call(*given, **named):
        global calls
        calls += 1
        if calls == last:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*given, **named)
    return call


with atomic_output_set(folder, replaces=[Path("maps/gone.txt")]) as made:
    (made / "maps").mkdir()
    for number in range(3):
        (made / f"{number}.txt").write_text("new")
        (made / "maps" / f"{number}.txt").write_text("new")
    for name in ("link", "replace", "rename", "unlink", "rmdir", "scandir"):
        setattr(os, name, dying(getattr(os, name)))
    swapped_folder._exchange_names = dying(swapped_folder._exchange_names)
    swapped_folder.shutil.rmtree = dying(swapped_folder.shutil.rmtree)
print(calls)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux exchanges folders")
def test_a_run_killed_at_any_moment_leaves_all_old_files_or_all_new(tmp_path):
    """At each call that changes names, until the run gets through."""
    folder, outcomes = tmp_path / "results", []
    new = {f"{n}.txt": "new" for n in range(3)}
    new |= {f"maps/{name}": text for name, text in new.items()} | {"own.txt": "mine"}
    old = dict.fromkeys([*new, "maps/gone.txt"], "old") | {"own.txt": "mine"}
    for last in range(1, 60):
        for left in tmp_path.iterdir():
            shutil.rmtree(left)
        (folder / "maps").mkdir(parents=True)
        for name, text in old.items():
            (folder / name).write_text(text)
        words = [sys.executable, "-c", KILLED, str(folder), str(last)]
        run = subprocess.run(words, capture_output=True, text=True)
        seen = {n: t for n, t in contents(folder).items() if not n.startswith(".")}
        assert seen in (old, new), last
        outcomes.append(seen == new)
        if run.returncode == 0:
            break
    assert run.returncode == 0, run.stderr
    assert outcomes == sorted(outcomes)
    assert outcomes.count(False) > 5
    with atomic_output_set(folder) as made:
        write(made, again="new")
    assert os.listdir(tmp_path) == ["results"]


def test_what_somebody_keeps_in_the_folder_stays_the_same_file(tmp_path):
    """Its links, its empty folders, its permissions; and what came in meanwhile."""
    folder = tmp_path / "results"
    folder.mkdir(mode=0o750)
    write(folder, report="old", notes__a="mine")
    (folder / "empty").mkdir()
    (folder / "link").symlink_to("notes/a.txt")
    kept, mode = (folder / "notes" / "a.txt").stat().st_ino, folder.stat().st_mode
    with atomic_output_set(folder) as made:
        write(made, report="new")
        write(folder, late="mine")
    assert contents(folder)["report.txt"] == "new"
    assert contents(folder)["late.txt"] == "mine"
    assert (folder / "notes" / "a.txt").stat().st_ino == kept
    assert folder.stat().st_mode == mode
    assert (folder / "empty").is_dir()
    assert (folder / "link").is_symlink()
    assert os.listdir(tmp_path) == ["results"]


def test_a_folder_that_one_works_in_stays_the_same_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = tmp_path.stat().st_ino
    with atomic_output_set(tmp_path) as made:
        write(made, report="new")
    assert tmp_path.stat().st_ino == before
    assert contents(Path()) == {"report.txt": "new"}

"""Atomic output sets: the outputs of one run appear all at once, or none of them.

Files that belong together (a preset beside UV maps and a report of one fit) are made in
a hidden folder within their final folder. When the last of them is whole, a folder with
them and with the other files of the final folder is exchanged with it in one step of
the system (`lensfit.swapped_folder`): a run that is killed at any moment leaves all
of the old files or all of the new. Where that is impossible the files are renamed one
after the other. An earlier stop of the run, Ctrl-C included, leaves the folder as it
was. Files of an earlier run that this one did not write are removed.

The hidden folder of a killed process is removed by the next run on its machine.
"""

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from lensfit.atomic import (
    cannot_write,
    owner,
    remove_abandoned,
    write_bytes_atomic,
)
from lensfit.errors import OutputError
from lensfit.swapped_folder import exchange_folder

_NAME = "unfinished"


@contextmanager
def atomic_output_set(
    folder: str | Path, *, last: Sequence[str] = (), replaces: Iterable[Path] = ()
) -> Iterator[Path]:
    """A hidden folder to write to, whose files move to `folder` if the block ends well.

    Ctrl-C during the moves waits for them: the outputs are then all there.

    Parameters
    ----------
    folder : Made if missing, and taken back if the block raises.
    last : Files that get their names after all others, in this order.
    replaces : Files of an earlier run, relative to `folder`.

    Raises
    ------
    OutputError : The folder cannot be made or written, or a file of `replaces` cannot
        be removed.
    """
    folder = Path(folder)
    with taken_back_if_empty(folder), _hidden(folder) as made:
        yield made
        # An interrupt reaches the main thread alone, which waits for this one.
        with ThreadPoolExecutor(1) as pool:
            moves = pool.submit(_appear, made, folder, last, list(replaces))
            moves.result()


def _appear(
    made: Path, folder: Path, last: Sequence[str], replaces: list[Path]
) -> None:
    if not exchange_folder(made, folder, replaces):
        move_all(made, folder, last=last, replaces=replaces)


def remove_unfinished(folder: Path) -> None:
    """What a process that was killed left there, and the folder if nothing else is."""
    remove_abandoned(folder / _NAME)
    _remove_if_empty(folder)


@contextmanager
def taken_back_if_empty(folder: Path) -> Iterator[None]:
    """Remove a folder that was made in the block, if nothing was put into it."""
    was_there = folder.exists()
    try:
        yield
    finally:
        if not was_there:
            _remove_if_empty(folder)


def move_all(
    made: Path, folder: Path, *, last: Sequence[str] = (), replaces: Iterable[Path] = ()
) -> None:
    """Move every file below `made` to its place below `folder`; see `atomic_set`.

    Raises
    ------
    OutputError : A file cannot be written, or one of `replaces` cannot be removed.
    """
    names = sorted(p.relative_to(made) for p in made.rglob("*") if p.is_file())
    final = [Path(name) for name in last if Path(name) in names]
    for name in [n for n in names if n not in final] + final:
        _move(made / name, folder / name)
    # Some file systems take names that differ in case for one.
    kept = {str(name).casefold() for name in names}
    for name in replaces:
        if str(name).casefold() not in kept:
            _remove(folder / name)


@contextmanager
def _hidden(folder: Path) -> Iterator[Path]:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        remove_abandoned(folder / _NAME)
        made = Path(tempfile.mkdtemp(dir=folder, prefix=f".{_NAME}.{owner()}."))
    except OSError as error:
        raise cannot_write(folder, error) from error
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _move(made: Path, path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        os.replace(made, path)
    except OSError as error:
        if error.errno != errno.EXDEV:
            raise cannot_write(path, error) from error
        # A subfolder may be a link to another disk.
        write_bytes_atomic(path, made.read_bytes())


def _remove(path: Path) -> None:
    """And its folder, if it was the last file there."""
    try:
        if path.is_file():
            path.unlink()
    except OSError as error:
        raise OutputError(
            f"is of an earlier run and cannot be removed ({error.strerror})",
            where=path,
            remedy="remove it",
        ) from error
    _remove_if_empty(path.parent)


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()

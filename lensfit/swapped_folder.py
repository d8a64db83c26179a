"""Replace files in a folder in one step, by exchanging it with another folder.

The other folder lies beside it and holds the new files and, as second names of the same
files (hard links), all that the old one keeps. Linux exchanges two names at once
(``renameat2`` with ``RENAME_EXCHANGE``), so that nobody ever sees some of the new files
among old ones.

The folder is then another one under the same name. Where that would be noticed (this
process works in it) or is impossible (a link, a mount, a file system without hard
links, another system), nothing is done.
"""

import ctypes
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from lensfit.atomic import owner, remove_abandoned

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2


def exchange_folder(made: Path, folder: Path, replaces: Iterable[Path]) -> bool:
    """Give all files below `made` their places below `folder` in one step.

    Parameters
    ----------
    made : A folder within `folder`, whose files stay where they are if it fails.
    replaces : Files, relative to `folder`, that go away unless they are made anew.

    Returns
    -------
    Whether it was done; `folder` is as it was if not.
    """
    if folder.is_symlink() or _stands_in(folder):
        return False
    try:
        remove_abandoned(folder)
        whole = Path(
            tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.stem}.{owner()}.")
        )
    except OSError:
        return False
    done = False
    try:
        kept = _fill_folder(whole, made, folder, set(replaces))
        shutil.copystat(folder, whole)
        done = _exchange_names(whole, folder)
        if done:
            _late_files(whole, folder, whole / made.name, kept)
    except OSError:
        return done
    finally:
        shutil.rmtree(whole, ignore_errors=True)
    return done


def _stands_in(folder: Path) -> bool:
    """Whether this process works in the folder, as its user's shell then does."""
    with suppress(OSError):
        return Path.cwd().is_relative_to(folder.resolve())
    return True


def _fill_folder(
    whole: Path, made: Path, folder: Path, replaces: set[Path]
) -> set[Path]:
    """Link what is new, and what stays of the old; all that the old folder held.

    Raises
    ------
    OSError : Something cannot be linked, or a folder of new files is a link.
    """
    new = {p.relative_to(made) for p in made.rglob("*") if p.is_file()}
    gone = {str(name).casefold() for name in (*new, *replaces)}
    seen: set[Path] = set()
    for path in _entries(folder, made):
        name = path.relative_to(folder)
        seen.add(name)
        if path.is_symlink() or not path.is_dir():
            if str(name).casefold() in gone:
                continue
            (whole / name.parent).mkdir(parents=True, exist_ok=True)
            os.link(path, whole / name, follow_symlinks=False)
        elif not any(path.iterdir()):
            (whole / name).mkdir(parents=True)
    for name in sorted(new):
        target = whole / name
        if any(parent.is_symlink() for parent in target.parents if parent != whole):
            raise OSError(f"{name.parent} is a link")
        target.parent.mkdir(parents=True, exist_ok=True)
        os.link(made / name, target)
    return seen


def _entries(folder: Path, made: Path) -> Iterator[Path]:
    """All below a folder but what is below `made`; links are not followed."""
    for path in sorted(folder.iterdir()):
        if path == made:
            continue
        yield path
        if path.is_dir() and not path.is_symlink():
            yield from _entries(path, made)


def _exchange_names(one: Path, other: Path) -> bool:
    """Whether two names were exchanged."""
    if not sys.platform.startswith("linux"):
        return False
    rename = getattr(ctypes.CDLL(None), "renameat2", None)
    if rename is None:
        return False
    names = os.fsencode(one.absolute()), os.fsencode(other.absolute())
    found = rename(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE)
    return found == 0


def _late_files(old: Path, folder: Path, made: Path, seen: set[Path]) -> None:
    """Bring over what somebody put into the old folder in the meantime."""
    for path in _entries(old, made):
        name = path.relative_to(old)
        if name in seen or (path.is_dir() and not path.is_symlink()):
            continue
        if not (folder / name).exists():
            (folder / name.parent).mkdir(parents=True, exist_ok=True)
            os.replace(path, folder / name)

"""Numbered files that are never overwritten: v001.json, v002.json and so on.

Any number of writers on any number of machines may save at once: each number is
claimed by one of them (`lensfit.atomic.claim`), and its file is whole from the first
moment. There are no locks, so that a writer that dies blocks nobody. A number is never
reused, not even when its file is deleted.
"""

import os
from pathlib import Path

from lensfit.atomic import claim, remove_abandoned, write_text_atomic, written_aside
from lensfit.errors import OutputError
from lensfit.preset.library.names import LAST_VERSION, version_name, version_number

_HIGHEST = ".highest"
"""Holds the highest number that was given out, in case its file is deleted."""


def version_path(folder: Path, number: int) -> Path:
    """The file of a version."""
    return folder / f"{version_name(number)}.json"


def versions_in(folder: Path) -> list[int]:
    """Numbers of the versions in a folder, rising; none where there is no folder.

    An empty file is a number that was claimed and never written.
    """
    return [n for n in _numbers(folder) if _holds_something(version_path(folder, n))]


def _numbers(folder: Path) -> list[int]:
    try:
        names = os.listdir(folder)
    except OSError:
        return []
    stems = [name.removesuffix(".json") for name in names if name.endswith(".json")]
    return sorted(n for stem in stems if (n := version_number(stem)) is not None)


def _holds_something(path: Path) -> bool:
    try:
        return path.is_file() and path.stat().st_size > 0
    except OSError:
        return False


def next_number(folder: Path) -> int:
    """The number after all that were ever given out.

    Raises
    ------
    OutputError : There is none after the last.
    """
    number = max(*_numbers(folder)[-1:], _highest(folder), 0) + 1
    if number > LAST_VERSION:
        raise OutputError(
            f"{version_name(LAST_VERSION)} is the last number a version can have",
            where=folder,
            remedy="remove the file of that name if nobody meant it",
        )
    return number


def claim_version(folder: Path, number: int, text: str) -> bool:
    """Write one version whole, unless its number is taken: whether it was not.

    Raises
    ------
    OutputError : The folder cannot be written.
    """
    target = version_path(folder, number)
    with written_aside(folder / "version.json", text.encode("utf-8")) as temporary:
        claimed = claim(temporary, target)
    if claimed:
        _tidy(folder, number)
    return claimed


def claim_next_version(folder: Path, text: str) -> int:
    """Write a new version and return its number, whoever else writes at that time.

    Raises
    ------
    OutputError : The folder cannot be written, or no number is left.
    """
    with written_aside(folder / "version.json", text.encode("utf-8")) as temporary:
        number = next_number(folder)
        while not claim(temporary, version_path(folder, number)):
            number = max(number + 1, next_number(folder))
    _tidy(folder, number)
    return number


def _tidy(folder: Path, number: int) -> None:
    # The version itself stands already: what fails here costs it nothing.
    try:
        if number > _highest(folder):
            write_text_atomic(folder / _HIGHEST, f"{number}\n")
        remove_abandoned(folder / "version.json")
    except (OSError, OutputError):
        return


def _highest(folder: Path) -> int:
    try:
        with (folder / _HIGHEST).open("rb") as file:
            text = file.read(8).strip()
    except OSError:
        return 0
    return int(text) if text.isdigit() and len(text) <= 6 else 0

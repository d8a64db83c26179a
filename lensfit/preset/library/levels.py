"""Where presets lie in a library: shot, sequence, project; numbered versions by lens.

A lens is a folder, named in lower-case ASCII after the lens and, behind an underscore,
its serial number: two copies of one lens are two lenses. A version is v001, v002 and so
on to v999999. A name from outside becomes a path only after it is checked here.

Any number of writers on any number of machines may save at once: each number is
claimed by one of them (`lensfit.atomic.claim`), and its file is whole from the first
moment. There are no locks, so that a writer that dies blocks nobody. A number is never
reused, not even when its file is deleted.

Any folder may be a level; its presets lie under ``lenses/LENS/``. From the folder that
is named, parents are levels too, up to one that is marked as a project (it holds
``lenses/project.json``). Without such a mark the named folder stands alone: a stray
folder higher up never takes part.
"""

import hashlib
import os
import re
import unicodedata
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from lensfit.atomic import claim, remove_abandoned, write_text_atomic, written_aside
from lensfit.errors import OutputError, PresetError

LAST_VERSION = 999_999
_LONGEST = 100
_SLUG = re.compile(r"[a-z0-9][a-z0-9_-]*")
_VERSION = re.compile(r"v(\d{3,6})")


def slug_of(name: str, serial: str | None = None) -> str:
    """The folder of a lens: ``smc-takumar-50-1-4_1234567``."""
    words = _plain_words(name) or "lens"
    return f"{words}_{_plain_words(serial)}" if serial else words


def _plain_words(text: str) -> str:
    """Lower-case words joined by "-"; what that loses is kept as six digits of a hash.

    Names in other alphabets, of signs alone, and very long ones, thus stay apart.
    """
    ascii_text = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    words = re.sub(r"[^a-z0-9]+", "-", ascii_text.lower()).strip("-")
    lost = any(
        c.isalnum() and not unicodedata.normalize("NFKD", c)[0].isascii() for c in text
    )
    lost |= not words and bool(text.strip())
    if not lost and len(words) <= _LONGEST:
        return words
    digits = hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()[:6]
    return f"{words[:_LONGEST]}-{digits}".lstrip("-")


def requested_slug(name: str) -> str:
    """The folder that a person means by a lens' name, or by a folder's."""
    return name if is_slug(name) else _plain_words(name)


def is_slug(name: str) -> bool:
    """Whether this may be the folder of a lens."""
    return len(name) <= 2 * _LONGEST + 16 and _SLUG.fullmatch(name) is not None


def version_name(number: int) -> str:
    """ "v001" and so on."""
    return f"v{number:03d}"


def version_number(name: str) -> int | None:
    """The number in "v001"; None if it is no name of a version."""
    match = _VERSION.fullmatch(name)
    if match is None or version_name(int(match[1])) != name or not int(match[1]):
        return None
    return int(match[1])


def requested_version(text: str) -> int:
    """The number that a person means by v002, v2 or 2.

    Raises
    ------
    PresetError : It is no version.
    """
    match = re.fullmatch(r"[vV]?0*([1-9][0-9]{0,5})", text, re.ASCII)
    if match is None:
        raise PresetError(
            f"{text[:40]!r} is no version",
            remedy="versions are v001, v002, ..., latest and default",
        )
    return int(match[1])


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


LENSES = "lenses"
ENVIRONMENT = "LENSFIT_LIBRARY"
_PROJECT = "project.json"


class Level(NamedTuple):
    """One folder of presets.

    Attributes
    ----------
    folder : Absolute; holds `lenses`.
    label : "project", "sq010", "sq010/sh0020"; "library" for one that stands alone.
    """

    folder: Path
    label: str

    @property
    def lenses(self) -> Path:
        """The folder of folders of lenses."""
        return self.folder / LENSES

    def shelf_folder(self, slug: str) -> Path:
        """The folder of one lens, which may not exist yet.

        Raises
        ------
        PresetError : A symbolic link leads out of the level.
        """
        folder = self.lenses / slug
        check_inside(self.folder, folder)
        return folder

    def slugs(self) -> list[str]:
        """Folders of lenses, in order."""
        try:
            found = sorted(os.listdir(self.lenses))
        except OSError:
            return []
        return [n for n in found if is_slug(n) and (self.lenses / n).is_dir()]


def check_inside(folder: Path, path: Path) -> None:
    """Refuse a path that links take out of a folder.

    Raises
    ------
    PresetError : `path` really lies outside `folder`.
    """
    root, real = os.path.realpath(folder), os.path.realpath(path)
    if os.path.commonpath([root, real]) != root:
        raise PresetError(
            "is or lies behind a symbolic link that leads out of the library",
            where=path,
            remedy="put the presets themselves there",
        )


def library_folder(named: Path | None = None) -> Path:
    """The named folder, or that of the environment, or the user's own."""
    if named is None and os.environ.get(ENVIRONMENT):
        named = Path(os.environ[ENVIRONMENT])
    if named is not None:
        return named
    import platformdirs

    return Path(platformdirs.user_data_dir("lensfit", appauthor=False))


def levels_of(library: Path | None = None) -> tuple[Level, ...]:
    """The levels of a library, nearest first.

    Parameters
    ----------
    library : The deepest level; see `library_folder` if None.

    Raises
    ------
    PresetError : A folder was named and is none.
    """
    nearest = Path(os.path.abspath(library_folder(library)))
    named = library is not None or os.environ.get(ENVIRONMENT)
    if named and not nearest.is_dir():
        raise PresetError(
            "is no folder",
            where=nearest,
            remedy=f"name a library with --library or {ENVIRONMENT}; to begin one, "
            'make the folder and mark that of a project with "lensfit preset project"',
        )
    above = [nearest]
    for folder in (nearest, *nearest.parents):
        if (folder / LENSES / _PROJECT).is_file():
            return tuple(Level(one, _label(one, folder)) for one in above)
        if folder.parent != folder:
            above.append(folder.parent)
    return (Level(nearest, "library"),)


def _label(folder: Path, project: Path) -> str:
    return "project" if folder == project else folder.relative_to(project).as_posix()


def mark_project(folder: Path, who: str) -> bool:
    """Make a folder the root of a project; False if it is one already.

    Raises
    ------
    OutputError : It is no folder, or cannot be written.
    """
    from lensfit.preset.store import to_json_text

    if not folder.is_dir():
        raise OutputError("is no folder", where=folder, remedy="make it first")
    path = folder / LENSES / _PROJECT
    check_inside(folder, path)
    said = {"schema": "lensfit.project.1", "who": who, "when": now()}
    with written_aside(path, to_json_text(said).encode()) as temporary:
        return claim(temporary, path)


def now() -> str:
    """Date and time, ISO 8601, UTC."""
    return datetime.now(UTC).isoformat(timespec="seconds")

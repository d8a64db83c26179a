"""One lens at one level: its versions, and the one in use.

When no version is named the latest is used, or a marked one. The mark is a small file
beside the versions. A later edit of the marked version is used in its place, since
whoever edits a lens wants the edit to take effect. To go back, mark the earlier version
again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import Struct

from lensfit._strict import convert_strictly, read_json_object
from lensfit.atomic import sync_folder, write_text_atomic
from lensfit.errors import PresetError
from lensfit.preset.library.change_set import (
    ChangeSet,
    change_set_of_tables,
    is_change_set,
)
from lensfit.preset.library.levels import (
    Level,
    check_inside,
    requested_version,
    version_name,
    version_number,
    version_path,
    versions_in,
)
from lensfit.preset.schema import Preset
from lensfit.preset.store import check_version, preset_of_tables, to_json_text, upgrade

KIND = "default"
_NAME = "default.json"
_LARGEST_BYTES = 2**16


class DefaultMark(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The version to use.

    Attributes
    ----------
    version : Such as "v002".
    latest : The latest version when the mark was set: edits after it count.
    """

    schema: Literal["lensfit.default.1"] = "lensfit.default.1"
    version: str
    latest: str
    who: str
    when: str


def read_mark(folder: Path) -> DefaultMark | None:
    """The mark of a lens, if there is one.

    Raises
    ------
    PresetError : There is one that cannot be read.
    """
    path = folder / _NAME
    if not path.is_file():
        return None
    tables = read_json_object(
        path,
        error=PresetError,
        source="mark the version again",
        mend="mark the version again",
        largest_bytes=_LARGEST_BYTES,
    )
    check_version(tables, path, kind=KIND, current_version=1)
    mark = convert_strictly(tables, DefaultMark, error=PresetError, where=path)
    for version in (mark.version, mark.latest):
        if version_number(version) is None:
            raise PresetError(f"{version[:40]!r} is no version", where=path)
    return mark


def write_mark(folder: Path, mark: DefaultMark) -> None:
    """Mark a version, in place of another.

    Raises
    ------
    OutputError : The folder cannot be written.
    """
    write_text_atomic(folder / _NAME, to_json_text(msgspec.to_builtins(mark)))
    sync_folder(folder)


def version_in_use(
    versions: Sequence[int],
    marked: int | None,
    latest_when_marked: int,
    continues: Callable[[int], int | None],
) -> int:
    """The version that counts when none is named.

    Parameters
    ----------
    versions : Those that there are, rising, at least one.
    marked : The marked one.
    latest_when_marked : The latest one when the mark was set.
    continues : The version that a version is an edit of, if it is one.
    """
    if marked is None:
        return versions[-1]
    for version in reversed(versions):
        if version <= latest_when_marked:
            break
        before = continues(version)
        while before is not None and before > marked:
            before = continues(before)
        if before == marked:
            return version
    return marked


@dataclass(frozen=True)
class Shelf:
    """The versions of one lens at one level, as they are when it is looked at."""

    level: Level
    slug: str

    @cached_property
    def folder(self) -> Path:
        """Where its versions lie."""
        return self.level.shelf_folder(self.slug)

    @cached_property
    def numbers(self) -> list[int]:
        """Of its versions, rising."""
        return versions_in(self.folder)

    @cached_property
    def mark(self) -> DefaultMark | None:
        """Its default mark."""
        return read_mark(self.folder)

    def path(self, number: int) -> Path:
        """The file of a version."""
        return version_path(self.folder, number)

    def number(self, requested: str | None) -> int:
        """The version that is meant.

        Parameters
        ----------
        requested : "v002", "latest", "default", or None for the one in use.

        Raises
        ------
        PresetError : There is no such version here.
        """
        if requested is None:
            return self.in_use()
        if requested == "latest":
            return self.numbers[-1]
        if requested == "default":
            if self.mark is None:
                raise PresetError(
                    "has no version marked as default",
                    where=self.folder,
                    remedy=f"mark one: lensfit preset default {self.slug}@v001",
                )
            return self.in_use()
        return self.existing(requested_version(requested))

    def existing(self, number: int) -> int:
        """The number, if there is such a version.

        Raises
        ------
        PresetError : There is not.
        """
        if number not in self.numbers:
            held = ", ".join(version_name(n) for n in self.numbers[-8:])
            raise PresetError(
                f"has no {version_name(number)}",
                where=self.folder,
                remedy=f"it holds {held}",
            )
        return number

    def in_use(self) -> int:
        """The version that counts when none is named.

        Raises
        ------
        PresetError : The mark cannot be read, or names a version that is gone.
        """
        if self.mark is None:
            return self.numbers[-1]
        marked = self.existing(version_number(self.mark.version) or 0)
        latest = version_number(self.mark.latest) or 0
        return version_in_use(self.numbers, marked, latest, self.continues)

    def continues(self, number: int) -> int | None:
        """The version that a version is an edit of; None for a whole preset."""
        try:
            found = self.read(number)
        except PresetError:
            return None  # whoever asks for that version is told
        if isinstance(found, Preset) or found.continues is None:
            return None
        before = version_number(found.continues)
        return before if before is not None and before < number else None

    def read(self, number: int) -> "Preset | ChangeSet":
        """A version as it stands.

        Raises
        ------
        PresetError : It cannot be read, or holds something it may not.
        """
        return read_version(self.path(number), self.level.folder)


def read_version(path: Path, inside: Path | None = None) -> "Preset | ChangeSet":
    """A preset or a change set, whichever the file is.

    Parameters
    ----------
    inside : The folder that no symbolic link may lead out of.

    Raises
    ------
    PresetError : It cannot be read, or holds something it may not.
    """
    if inside is not None:
        check_inside(inside, path)
    tables = read_json_object(
        path,
        error=PresetError,
        source="give a preset, or the name of a lens in a library",
        mend="restore or mend the file",
    )
    if is_change_set(tables):
        return change_set_of_tables(tables, path)
    return preset_of_tables(upgrade(tables, path), path)


def shelves_of(levels: tuple[Level, ...], slug: str) -> list[Shelf]:
    """The levels that hold a lens, nearest first."""
    shelves = [Shelf(level, slug) for level in levels]
    return [s for s in shelves if s.numbers]


def known_slugs(levels: tuple[Level, ...]) -> list[str]:
    """Lenses of all levels."""
    return sorted({s for level in levels for s in level.slugs()})

"""The version of a lens that is used when none is named: the latest, or a marked one.

The mark is a small file beside the versions. A later edit of the marked version is used
in its place, since whoever edits a lens wants the edit to take effect. To go back, mark
the earlier version again.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import Struct

from lensfit._strict import convert_strictly, read_json_object
from lensfit.atomic import sync_folder, write_text_atomic
from lensfit.errors import PresetError
from lensfit.preset.json_text import to_json_text
from lensfit.preset.library.names import version_number
from lensfit.preset.upgrade import check_version

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

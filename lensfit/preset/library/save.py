"""A whole preset into a library, as the next version of its lens."""

from pathlib import Path
from typing import NamedTuple

import msgspec

from lensfit.preset.library.default_mark import DefaultMark, write_mark
from lensfit.preset.library.levels import Level, now
from lensfit.preset.library.names import slug_of, version_name
from lensfit.preset.library.shelf import Shelf
from lensfit.preset.library.versions import claim_next_version, version_path
from lensfit.preset.schema import Preset, Saved
from lensfit.preset.store import preset_text


class Kept(NamedTuple):
    """Where a preset was saved."""

    slug: str
    number: int
    path: Path


def keep_preset(
    preset: Preset, level: Level, *, who: str, note: str = "", default: bool = False
) -> Kept:
    """Save a preset as the next version of its lens; nothing is ever overwritten.

    Parameters
    ----------
    default : Mark it as the version that is used when none is named.

    Raises
    ------
    PresetError : The preset holds what it may not, or the folder is a link out of the
        library.
    OutputError : The folder cannot be written.
    """
    slug = slug_of(preset.lens.name, preset.lens.serial)
    folder = level.shelf_folder(slug)
    old = preset.saved or Saved(who, now())
    saved = msgspec.structs.replace(old, who=who, when=now(), note=note)
    text = preset_text(msgspec.structs.replace(preset, saved=saved), folder)
    number = claim_next_version(folder, text)
    if default:
        mark_default(Shelf(level, slug), number, who)
    return Kept(slug, number, version_path(folder, number))


def mark_default(shelf: Shelf, number: int, who: str) -> None:
    """Mark a version as the one that is used when none is named.

    Raises
    ------
    PresetError : There is no such version.
    OutputError : The folder cannot be written.
    """
    mark = DefaultMark(
        version=version_name(shelf.existing(number)),
        latest=version_name(shelf.numbers[-1]),
        who=who,
        when=now(),
    )
    write_mark(shelf.folder, mark)

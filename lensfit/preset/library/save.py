"""A whole preset into a library, as the next version of its lens."""

from pathlib import Path
from typing import NamedTuple

import msgspec

from lensfit.errors import PresetError
from lensfit.preset.library.levels import Level, levels_of, now
from lensfit.preset.library.shelf import DefaultMark, Shelf, write_mark
from lensfit.preset.library.versions import (
    claim_next_version,
    slug_of,
    version_name,
    version_path,
)
from lensfit.preset.schema import LensName, Preset, Saved
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
    PresetError : The preset holds what it may not, the folder is a link out of the
        library, or another lens has it, whose name differs in signs alone.
    OutputError : The folder cannot be written.
    """
    slug = slug_of(preset.lens.name, preset.lens.serial)
    folder = level.shelf_folder(slug)
    _refuse_other_lens(preset.lens, level, slug)
    old = preset.saved or Saved(who, now())
    saved = msgspec.structs.replace(old, who=who, when=now(), note=note)
    text = preset_text(msgspec.structs.replace(preset, saved=saved), folder)
    number = claim_next_version(folder, text)
    if default:
        mark_default(Shelf(level, slug), number, who)
    return Kept(slug, number, version_path(folder, number))


def _refuse_other_lens(lens: LensName, level: Level, slug: str) -> None:
    """Names that come to one folder are two lenses unless they are alike but for case
    and spaces: "S4/i 50" and "S4-i (50)" would become versions of each other."""
    for around in levels_of(level.folder) if level.folder.is_dir() else ():
        known = _lens_of(Shelf(around, slug))
        if known is None or _alike(known) == _alike(lens):
            continue
        spelt = f'"{known.name}"' + (f", serial {known.serial}" if known.serial else "")
        raise PresetError(
            f'"{lens.name}" would become a version of another lens, {spelt}',
            where=around.lenses / slug,
            remedy="if it is that lens, give the preset its name (lens.name); if not, "
            "a name with other letters or digits, or a serial number (lens.serial)",
        )


def _lens_of(shelf: Shelf) -> LensName | None:
    """The lens of the newest version that holds a whole preset and can be read."""
    for number in reversed(shelf.numbers):
        try:
            found = shelf.read(number)
        except PresetError:
            continue  # whoever asks for that version is told
        if isinstance(found, Preset):
            return found.lens
    return None


def _alike(lens: LensName) -> tuple[str, str]:
    return _plain(lens.name), _plain(lens.serial or "")


def _plain(text: str) -> str:
    return " ".join(text.split()).casefold()


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

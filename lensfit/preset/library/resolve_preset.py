"""A preset by path or by name: ``takumar``, ``takumar@v002``, ``presets/a.json``.

A name is looked up at the levels of a library. Alone, or with "latest" or "default", it
means the nearest level that holds the lens. Versions are counted at each level by
itself: v001 of the shot is not v001 of the project. ``takumar@v001`` is that of the
nearest level which has one; ``project:takumar@v001`` says which level is meant.

A file of a library, or the folder of a lens in one, is read with the levels around it,
wherever one stands.
"""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from lensfit._strict import did_you_mean
from lensfit.errors import PresetError
from lensfit.preset.library.layers import FoundPreset, put_together
from lensfit.preset.library.levels import LENSES, Level, levels_of
from lensfit.preset.library.shelf import Shelf, known_slugs, read_version, shelves_of
from lensfit.preset.library.versions import (
    requested_slug,
    requested_version,
    version_name,
    version_number,
)
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset


def find_preset(text: str | Path, library: str | Path | None = None) -> FoundPreset:
    """The preset that a path or a name means.

    Parameters
    ----------
    text : A file, the folder of a lens in a library, or NAME, NAME@v002, NAME@latest,
        NAME@default, each also as LEVEL:NAME (levels as `Level.label` has them).
    library : The deepest level for names; the environment's or the user's if None.

    Raises
    ------
    PresetError : Nothing is found, more than one lens is meant, or it cannot be read.
    """
    path = Path(text)
    if _is(path, os.path.isfile):
        return _of_file(path)
    whole = Path(os.path.abspath(path))
    if _is(whole, os.path.isdir) and whole.parent.name == LENSES:
        levels, slug = levels_of(whole.parents[1]), whole.name
        shelves = _shelves(levels, lens_in(levels, slug))
        return put_together(shelves, shelves[0].in_use())
    if path.suffix == ".json" or path.is_absolute() or ".." in path.parts:
        return FoundPreset(load_preset(path), str(path), path)  # says what is wrong
    return _of_name(str(text), levels_of(None if library is None else Path(library)))


def _of_name(text: str, levels: tuple[Level, ...]) -> FoundPreset:
    label, colon, rest = text.rpartition(":")
    labels = [level.label for level in levels]
    if not colon or label not in labels:
        if colon and requested_slug(rest.partition("@")[0]) in known_slugs(levels):
            raise PresetError(
                f"{label[:80]!r} is no level here",
                where=levels[0].folder,
                remedy=f"levels are {', '.join(labels)}",
            )
        name, _, requested = text.partition("@")
        return _of_nearest(_shelves(levels, lens_in(levels, name)), requested)
    name, _, requested = rest.partition("@")
    levels = levels[labels.index(label) :]
    shelves = _shelves(levels, lens_in(levels, name))
    if shelves[0].level != levels[0]:
        raise PresetError(
            "holds no version",
            where=levels[0].lenses / shelves[0].slug,
            remedy=f"the nearest is {shelves[0].level.label}:{shelves[0].slug}",
        )
    return put_together(shelves, shelves[0].number(requested or None))


def _shelves(levels: tuple[Level, ...], slug: str) -> list[Shelf]:
    """The levels that hold a lens; at least one."""
    shelves = shelves_of(levels, slug)
    if not shelves:
        raise PresetError("holds no version", where=levels[0].lenses / slug)
    return shelves


def _of_nearest(shelves: list[Shelf], requested: str) -> FoundPreset:
    """What a version means at a level that nobody named; where others would do, too,
    that is noted."""
    if requested in ("", "latest", "default"):
        return put_together(shelves, shelves[0].number(requested or None))
    number = requested_version(requested)
    at, *others = [n for n, s in enumerate(shelves) if number in s.numbers] or [0]
    found = put_together(shelves[at:], shelves[at].existing(number))
    if not at and not others:
        return found
    named = f"{shelves[at].slug}@{version_name(number)}"
    note = f"{named} is that of {shelves[at].level.label}"
    if others:
        named = [f"{shelves[n].level.label}:{named}" for n in others]
        note += f"; others of that number are {', '.join(named)}"
    else:
        note += (
            f", without what {shelves[0].level.label} says: that has no such version"
        )
    return replace(found, notes=(*found.notes, note))


def _is(path: Path, kind: Any) -> bool:
    try:
        return kind(path)
    except (OSError, ValueError):
        return False


def lens_in(levels: tuple[Level, ...], name: str) -> str:
    """The folder of the lens that a name means; a serial may be left out.

    Raises
    ------
    PresetError : There is none, or there are several.
    """
    slug, known = requested_slug(name), known_slugs(levels)
    if slug in known and slug:
        return slug
    meant = [one for one in known if slug and one.startswith(f"{slug}_")]
    if len(meant) == 1:
        return meant[0]
    where = levels[0].lenses
    if meant:
        raise PresetError(
            f"{name[:80]!r} is the name of several lenses",
            where=where,
            remedy=f"say which: {', '.join(meant)}",
        )
    near = [one for one in known if slug and slug in one] or known
    hint = did_you_mean(slug, near) if known else "save one: lensfit preset save"
    if len(near) == 1:
        hint = f'did you mean "{near[0]}"?'
    raise PresetError(
        f"{name[:80]!r} is neither a file nor a lens of this library",
        where=where,
        remedy=hint[:300],
    )


def _of_file(path: Path) -> FoundPreset:
    found = read_version(path)
    if isinstance(found, Preset):
        return FoundPreset(found, str(path), path)
    where = Path(os.path.abspath(path))
    number = version_number(where.stem)
    if number is None or where.parent.parent.name != LENSES:
        raise PresetError(
            "is a change set outside a library, so what it changes is not known",
            where=path,
            remedy="name the file in its library",
        )
    levels, slug = levels_of(where.parents[2]), where.parent.name
    shelves = [Shelf(levels[0], slug), *shelves_of(levels[1:], slug)]
    return put_together(shelves, number)

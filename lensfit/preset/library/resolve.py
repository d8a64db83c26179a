"""A preset by path or by name: ``takumar``, ``takumar@v002``, ``presets/a.json``.

A name is looked up at the levels of a library; the nearest that holds the lens says
which versions there are. A file of a library, or the folder of a lens in one, is read
with the levels around it, wherever one stands.
"""

import os
from pathlib import Path
from typing import Any

from lensfit._strict import did_you_mean
from lensfit.errors import PresetError
from lensfit.preset.library.found import Found
from lensfit.preset.library.layers import put_together
from lensfit.preset.library.levels import LENSES, Level, levels_of
from lensfit.preset.library.names import asked_slug, version_number
from lensfit.preset.library.shelf import Shelf, known_slugs, read_version, shelves_of
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset


def find_preset(text: str | Path, library: str | Path | None = None) -> Found:
    """The preset that a path or a name means.

    Parameters
    ----------
    text : A file, the folder of a lens in a library, or NAME, NAME@v002, NAME@latest,
        NAME@default.
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
        levels, name, asked = levels_of(whole.parents[1]), whole.name, ""
    elif path.suffix == ".json" or path.is_absolute() or ".." in path.parts:
        return Found(load_preset(path), str(path), path)  # says what is wrong
    else:
        name, _, asked = str(text).partition("@")
        levels = levels_of(None if library is None else Path(library))
    slug = lens_in(levels, name)
    shelves = shelves_of(levels, slug)
    if not shelves:
        raise PresetError("holds no version", where=levels[0].lenses / slug)
    return put_together(shelves, shelves[0].number(asked or None))


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
    slug, known = asked_slug(name), known_slugs(levels)
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


def _of_file(path: Path) -> Found:
    found = read_version(path)
    if isinstance(found, Preset):
        return Found(found, str(path), path)
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

"""The content of a library: its lenses, their history, and whether all can be used.

A history lists every version at every level, with author, time and reason.
"""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from lensfit._strict import read_json_object
from lensfit.errors import LensfitError, PresetError
from lensfit.preset.library.change_set import Change, ChangeSet, is_change_set
from lensfit.preset.library.layers import find_preset, put_together, value_text
from lensfit.preset.library.levels import (
    LENSES,
    Level,
    levels_of,
    version_name,
    version_number,
    version_path,
    versions_in,
)
from lensfit.preset.library.shelf import Shelf, shelves_of
from lensfit.preset.schema import Preset
from lensfit.preset.store import load_preset


class Event(NamedTuple):
    """One version.

    Attributes
    ----------
    who, when : Empty where nobody said.
    what : A sentence for each thing that it changed.
    in_use : Whether it counts at its level when none is named.
    """

    level: str
    version: str
    when: str
    who: str
    what: tuple[str, ...]
    in_use: bool


def history(shelves: list[Shelf]) -> list[Event]:
    """Versions of a lens, outermost level first, oldest first."""
    return [
        _event(shelf, number) for shelf in reversed(shelves) for number in shelf.numbers
    ]


def _event(shelf: Shelf, number: int) -> Event:
    try:
        in_use = shelf.in_use() == number
    except PresetError:
        in_use = False
    try:
        found = shelf.read(number)
    except PresetError as fault:
        who, when, what = "", "", (f"cannot be used: {fault.what}",)
    else:
        event_of = _preset_history if isinstance(found, Preset) else _change_set_history
        who, when, what = event_of(found, shelf)  # pyright: ignore[reportArgumentType]
    return Event(shelf.level.label, version_name(number), when, who, what, in_use)


def _preset_history(preset: Preset, shelf: Shelf) -> tuple[str, str, tuple[str, ...]]:
    made, saved = preset.provenance, preset.saved
    what = f"preset made {made.created} from {len(made.images)} photographs"
    if saved is None:
        return "", made.created, (what,)
    origin = f", taken from {saved.origin}" if saved.origin else ""
    note = f": {saved.note}" if saved.note else ""
    return saved.who, saved.when, (f"{what}{origin}{note}",)


def _change_set_history(
    changes: ChangeSet, shelf: Shelf
) -> tuple[str, str, tuple[str, ...]]:
    new = changes.changes[_shelved_change_count(changes, shelf) :]
    last = changes.changes[-1]
    return last.who, last.when, tuple(_change_sentence(change) for change in new)


def _shelved_change_count(changes: ChangeSet, shelf: Shelf) -> int:
    """How many of the changes an earlier version holds already."""
    number = version_number(changes.continues or "")
    if number is None or number not in shelf.numbers:
        return 0
    try:
        before = shelf.read(number)
    except PresetError:
        return 0
    if isinstance(before, Preset):
        return 0
    count = len(before.changes)
    return count if changes.changes[:count] == before.changes else 0


def _change_sentence(change: Change) -> str:
    unlocked = " (unlocked)" if change.unlocked else ""
    if change.dropped:
        done = f"{change.key}: {value_text(change.before)} dropped"
    else:
        before, value = value_text(change.before), value_text(change.value)
        done = f"{change.key}: {before} -> {value}"
    return f"{done}{unlocked}: {change.why}"


class Row(NamedTuple):
    """A lens at one level.

    Attributes
    ----------
    slug : Its folder.
    versions : Names, rising.
    in_use : The one that counts when none is named; None if that cannot be told.
    marked : The default mark, or None.
    lens : Name as it was measured; None if it cannot be read.
    change_set : Whether the version in use holds only what differs here.
    fault : Why it cannot be used, or None.
    """

    slug: str
    level: str
    versions: tuple[str, ...]
    in_use: str | None
    marked: str | None
    lens: str | None
    change_set: bool
    fault: str | None


def catalogue(levels: tuple[Level, ...]) -> list[Row]:
    """Every lens at every level, nearest level first."""
    return [
        _row(levels[at:], slug)
        for at in range(len(levels))
        for slug in levels[at].slugs()
    ]


def _row(levels: tuple[Level, ...], slug: str) -> Row:
    level = levels[0]
    row = Row(slug, level.label, (), None, None, None, False, None)
    try:
        shelf = Shelf(level, slug)
        row = row._replace(versions=tuple(version_name(n) for n in shelf.numbers))
        if not shelf.numbers:
            return row._replace(fault="holds no version")
        mark = shelf.mark
        number = shelf.in_use()
        row = row._replace(
            in_use=version_name(number), marked=mark.version if mark else None
        )
        found = put_together([shelf, *shelves_of(levels[1:], slug)], number)
    except PresetError as fault:
        return row._replace(fault=str(fault))
    return row._replace(lens=found.preset.lens.name, change_set=len(found.parts) > 1)


def validation_faults(path: Path) -> dict[str, str | None]:
    """Files and what is wrong with each; None where nothing is.

    Parameters
    ----------
    path : A preset, a change set, the folder of a lens, or a library: of that, the
        named level and those around it.
    """
    if not path.is_dir():
        return {str(path): _fault(lambda: _check_file(path))}
    found: dict[str, str | None] = {}
    for name, check in _checks(path):
        found[name] = _fault(check)
    if not found:
        said = PresetError(
            "holds no lenses", where=path, remedy="name a preset or a library"
        )
        found[str(path)] = str(said)
    return found


def _fault(check: Callable[[], object]) -> str | None:
    try:
        check()
    except LensfitError as error:
        return str(error)
    return None


def _check_file(path: Path) -> None:
    tables = read_json_object(
        path, error=PresetError, source="name a preset", mend="restore or mend the file"
    )
    if is_change_set(tables):
        find_preset(path)
    else:
        load_preset(path)


def _checks(folder: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    whole = Path(os.path.abspath(folder))
    if whole.parent.name == LENSES:
        levels, slugs = levels_of(whole.parents[1])[:1], [whole.name]
    else:
        levels, slugs = levels_of(folder), None
    around = levels_of(levels[0].folder)
    for at, level in enumerate(levels):
        for slug in slugs or level.slugs():
            yield from _checks_of_shelf(around[at:], slug)


def _checks_of_shelf(
    levels: tuple[Level, ...], slug: str
) -> Iterator[tuple[str, Callable[[], object]]]:
    folder = levels[0].lenses / slug
    yield str(folder), lambda: levels[0].shelf_folder(slug)
    if _fault(lambda: levels[0].shelf_folder(slug)):
        return

    def whole(number: int) -> None:
        shelves = [Shelf(levels[0], slug), *shelves_of(levels[1:], slug)]
        put_together(shelves, number)

    def mark() -> None:
        Shelf(levels[0], slug).in_use()

    def stranger(path: Path) -> None:
        raise PresetError(
            "is no version, or was claimed by a save that never ended",
            where=path,
            remedy="remove it; versions are v001.json to v999999.json",
        )

    numbers = versions_in(folder)
    for number in numbers:
        yield str(version_path(folder, number)), lambda n=number: whole(n)
    if numbers and (folder / "default.json").exists():
        yield str(folder / "default.json"), mark
    known = {version_path(folder, n).name for n in numbers} | {"default.json"}
    for name in sorted(os.listdir(folder)):
        if name.endswith(".json") and not name.startswith(".") and name not in known:
            yield str(folder / name), lambda p=folder / name: stranger(p)

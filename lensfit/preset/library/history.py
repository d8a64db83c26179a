"""The history of a lens: every version at every level, with author, time and reason."""

from typing import NamedTuple

from lensfit.errors import PresetError
from lensfit.preset.library.change_set import Change, ChangeSet
from lensfit.preset.library.found import value_text
from lensfit.preset.library.names import version_name, version_number
from lensfit.preset.library.shelf import Shelf
from lensfit.preset.schema import Preset


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
        event_of = _of_preset if isinstance(found, Preset) else _of_changes
        who, when, what = event_of(found, shelf)  # pyright: ignore[reportArgumentType]
    return Event(shelf.level.label, version_name(number), when, who, what, in_use)


def _of_preset(preset: Preset, shelf: Shelf) -> tuple[str, str, tuple[str, ...]]:
    made, saved = preset.provenance, preset.saved
    what = f"preset made {made.created} from {len(made.images)} photographs"
    if saved is None:
        return "", made.created, (what,)
    origin = f", taken from {saved.origin}" if saved.origin else ""
    note = f": {saved.note}" if saved.note else ""
    return saved.who, saved.when, (f"{what}{origin}{note}",)


def _of_changes(changes: ChangeSet, shelf: Shelf) -> tuple[str, str, tuple[str, ...]]:
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

"""Edits: a new version with one more change, and its author, time and reason.

An edit is made to the version in use at the named level, or to one that is named. Where
the level has none of its own, its first change set is based on the next level outwards.
Nothing is overwritten: of two edits at once, the second is made anew on the first.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from lensfit._strict import check_extent
from lensfit.errors import PresetError
from lensfit.preset.library.change_set import (
    Base,
    Change,
    ChangeSet,
    change_set_text,
    check_lock,
    lock_of,
)
from lensfit.preset.library.key_path import (
    MISSING,
    Tables,
    complete_tables,
    key_of,
    steps_of,
    value_at,
)
from lensfit.preset.library.layers import (
    FoundPreset,
    put_beneath,
    put_together,
    value_text,
    with_layer,
)
from lensfit.preset.library.levels import levels_of, now
from lensfit.preset.library.resolve_preset import lens_in
from lensfit.preset.library.shelf import Shelf, shelves_of
from lensfit.preset.library.versions import claim_version, next_number, version_name
from lensfit.preset.schema import Preset

_TRIES = 10_000


class RequestedEdit(NamedTuple):
    """A requested edit of a key: a new value, or to drop that of this level."""

    key: str
    value: Any = None
    drop: bool = False


class Author(NamedTuple):
    """Who edits, and why."""

    who: str
    why: str


def requested_edit_of_text(text: str) -> RequestedEdit:
    """KEY=VALUE as it is typed; the value is JSON, or else text.

    Raises
    ------
    PresetError : There is no "=", or the value is too large or too deep.
    """
    depth = 0
    for at, letter in enumerate(text):
        depth += (letter == "[") - (letter == "]")
        if letter == "=" and depth == 0:
            return RequestedEdit(text[:at].strip(), _value(text[at + 1 :].strip()))
    raise PresetError(f"{text[:80]!r} is not KEY=VALUE", remedy="write coma_gain=0.5")


def _value(text: str) -> Any:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        value = text
    try:
        check_extent(value)
    except ValueError as reason:
        raise PresetError(f"{text[:80]!r} is {reason}") from reason
    return value


def edit_preset(
    name: str,
    wishes: Sequence[RequestedEdit],
    author: Author,
    *,
    library: Path | None = None,
    unlock: bool = False,
    pin: bool = False,
) -> FoundPreset:
    """Make one new version with these changes, and return what it is.

    Parameters
    ----------
    name : NAME or NAME@v002.
    library : The level that is edited.
    unlock : Measured values may be changed.
    pin : A first change set stands on the version now in use further out, whatever is
        saved there later.

    Raises
    ------
    PresetError : There is no such lens or key, it is locked, or the value does not fit.
    OutputError : The level cannot be written.
    """
    if not author.why.strip() or not author.who.strip():
        raise PresetError("an edit says who and why", remedy="give --who and --why")
    if not wishes:
        raise PresetError("nothing to change", remedy="give --set or --drop")
    levels = levels_of(library)
    lens, _, requested = name.partition("@")
    slug = lens_in(levels, lens)
    for _ in range(_TRIES):
        here = Shelf(levels[0], slug)
        shelves = [here, *shelves_of(levels[1:], slug)]
        number = next_number(here.folder)
        if here.numbers and here.numbers[-1] >= number:
            continue  # saved just now
        before = _start(shelves, requested or None, pin)
        changes = _changed(shelves, number, before, wishes, author, unlock)
        found = with_layer(shelves, number, changes)
        if claim_version(here.folder, number, change_set_text(changes)):
            return found
    raise PresetError("others edit it all the time", where=here.folder)


def _start(shelves: list[Shelf], requested: str | None, pin: bool) -> ChangeSet:
    """What the edit continues: a set of changes, maybe none yet."""
    here = shelves[0]
    if not here.numbers:
        if len(shelves) < 2:
            raise PresetError("holds no version", where=here.folder)
        version = None
        if requested is not None or pin:
            version = version_name(shelves[1].number(requested))
        return ChangeSet(
            lens=here.slug, base=Base("outer", version), continues=None, changes=()
        )
    number = here.number(requested)
    name, found = version_name(number), here.read(number)
    if isinstance(found, Preset):
        base, changes = Base("here", name), ()
    else:
        base, changes = found.base, found.changes
    return ChangeSet(lens=here.slug, base=base, continues=name, changes=changes)


def _changed(
    shelves: list[Shelf],
    number: int,
    before: ChangeSet,
    wishes: Sequence[RequestedEdit],
    author: Author,
    unlock: bool,
) -> ChangeSet:
    """`before` with one more change for each wish."""

    def looked_at(changes: ChangeSet) -> FoundPreset:
        if not changes.changes:
            return put_together(*put_beneath(shelves, number, changes))
        try:
            return with_layer(shelves, number, changes)
        except PresetError as fault:
            if fault.where != shelves[0].path(number):
                raise
            # That file is not there yet, and will not be.
            raise PresetError(fault.what, remedy=fault.remedy) from fault

    # First, for it mends a level whose keys are gone from the preset beneath.
    for wish in wishes:
        if wish.drop:
            check_lock(wish.key, steps_of(wish.key), unlocked=unlock)
            key = _own_key(before, wish.key, shelves[0].level.label)
            before = _with(before, _dropped(before.effective_changes()[key], author))
    found = looked_at(before)
    for wish in wishes:
        if not wish.drop:
            check_lock(wish.key, steps_of(wish.key), unlocked=unlock)
            change = _change(complete_tables(found.preset), wish, author)
            found = looked_at(_with(before, change))
            # As it is kept: a whole number where a length belongs becomes 50.0.
            kept = value_at(complete_tables(found.preset), steps_of(change.key))
            own = before.effective_changes().get(change.key)
            if own is not None and kept == own.value:
                raise PresetError(f"{change.key}: is {value_text(kept)} already")
            before = _with(before, msgspec.structs.replace(change, value=kept))
    return before


def _own_key(changes: ChangeSet, key: str, level: str) -> str:
    """The key as the level's changes spell it."""
    meant = steps_of(key)
    own = [k for k in changes.effective_changes() if steps_of(k) == meant]
    if not own:
        here = ", ".join(changes.effective_changes()) or "nothing"
        raise PresetError(
            f"{key}: is not changed at {level}", remedy=f"changed is {here}"
        )
    return own[0]


def _dropped(change: Change, author: Author) -> Change:
    """The change taken back."""
    return Change(
        key=change.key,
        value=None,
        before=change.value,
        who=author.who.strip(),
        when=now(),
        why=author.why.strip(),
        unlocked=change.unlocked,
        dropped=True,
    )


def _change(tables: Tables, wish: RequestedEdit, author: Author) -> Change:
    """A wish as it goes on record."""
    steps = steps_of(wish.key)
    before = value_at(tables, steps)
    return Change(
        key=key_of(tables, steps),
        value=wish.value,
        before=None if before is MISSING else before,
        who=author.who.strip(),
        when=now(),
        why=author.why.strip(),
        unlocked=lock_of(steps) == "locked",
    )


def _with(changes: ChangeSet, change: Change) -> ChangeSet:
    return ChangeSet(
        lens=changes.lens,
        base=changes.base,
        continues=changes.continues,
        changes=(*changes.changes, change),
    )

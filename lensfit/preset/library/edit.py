"""New versions of a lens in a library: a whole preset, or an edit with its reason.

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
    lens_in,
    put_beneath,
    put_together,
    value_text,
    with_layer,
)
from lensfit.preset.library.levels import (
    Level,
    claim_next_version,
    claim_version,
    levels_of,
    next_number,
    now,
    slug_of,
    version_name,
    version_path,
)
from lensfit.preset.library.shelf import DefaultMark, Shelf, shelves_of, write_mark
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
        changes = _with_wishes(shelves, number, before, wishes, author, unlock)
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


def _with_wishes(
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
            before = _with(
                before, _withdrawn_change(before.effective_changes()[key], author)
            )
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


def _withdrawn_change(change: Change, author: Author) -> Change:
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

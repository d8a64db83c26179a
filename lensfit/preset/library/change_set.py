"""A change set: the keys that one level changes on top of a whole preset.

The file is JSON, schema "lensfit.change_set.1", one version among those of its lens.
It holds every edit made at its level since the preset it is based on, in order; of
several edits of a key the last counts. An edit records author, time, reason and the
previous value.

Knobs may always be changed. Measured values are locked, so that a number in a preset is
the measured one unless an edit records why not. Records of the measurement (provenance,
quality, the state of an entry) cannot be changed at all: changing them would make them
false.
"""

from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from lensfit._strict import convert_strictly, did_you_mean, non_finite_numbers
from lensfit.errors import PresetError
from lensfit.preset.entry import Entry
from lensfit.preset.knobs import GROUP_OF
from lensfit.preset.library.key_path import IDENTITY, Step, steps_of
from lensfit.preset.library.levels import is_slug, version_number
from lensfit.preset.schema import Preset
from lensfit.preset.store import (
    check_version,
    key_with_pupil_shift,
    to_json_text,
    with_pupil_shift,
)

Lock = Literal["free", "locked", "record"]

_RECORDS = ("schema", "conventions", "provenance", "saved")
_RECORDS_OF_ENTRY = ("terms", "covariance", "quality")


def lock_of(steps: tuple[Step, ...]) -> Lock:
    """How a key is locked."""
    names = [step for step in steps if isinstance(step, str)]
    if names[0] == "knobs":
        return "free"
    if names[0] in _RECORDS or names == ["entries"]:
        return "record"
    if names[0] == "entries" and (len(names) < 2 or names[1] in _RECORDS_OF_ENTRY):
        return "record"
    if "covariance" in names:
        return "record"
    if len(names) > 1 and names[-1] in IDENTITY.get(names[-2], ()):
        return "record"
    return "locked"


def check_lock(key: str, steps: tuple[Step, ...], *, unlocked: bool) -> None:
    """Refuse to change what an edit may not.

    Parameters
    ----------
    steps : The key, parted (`lensfit.preset.library.key_path`).
    unlocked : Whether somebody said that a measured value is to be changed.

    Raises
    ------
    PresetError : The key is unknown, a record, or measured and not unlocked.
    """
    if steps[0] not in Preset.__struct_fields__:
        known = [*GROUP_OF, *Preset.__struct_fields__]
        hint = did_you_mean(str(steps[0]), known)
        raise PresetError(f'unknown key "{key[:80]}"; {hint}')
    lock = lock_of(steps)
    if lock == "record":
        raise PresetError(
            f"{key}: is a record of the measurement, which no edit changes",
            remedy=f"change knobs, or values of an entry ({', '.join(_VALUES)})",
        )
    if lock == "locked" and not unlocked:
        raise PresetError(
            f"{key}: was measured and is locked",
            remedy="turn a knob, or change it with --unlock, which the edit records",
        )


_VALUES = tuple(
    name
    for name in Entry.__struct_fields__
    if name not in (*_RECORDS_OF_ENTRY, *IDENTITY["entries"])
)

KIND = "change_set"
Text = Annotated[str, Meta(min_length=1, max_length=2000)]


class Base(Struct, frozen=True, forbid_unknown_fields=True):
    """The preset that the changes are made to.

    Attributes
    ----------
    level : "here" for a version of the same level, "outer" for the next level that
        holds the lens.
    version : Such as "v001"; None for whichever is in use there.
    """

    level: Literal["here", "outer"]
    version: str | None = None


class Change(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One edit.

    Attributes
    ----------
    key : As `key_path.key_of` spells it.
    value, before : What stands there now, and what stood there.
    who, when, why : The edit's author, time (ISO 8601 with time zone) and reason.
    unlocked : Whether a measured value was changed, knowingly.
    dropped : Whether the key was given back to the preset beneath.
    """

    key: Text
    value: Any
    before: Any
    who: Text
    when: Text
    why: Text
    unlocked: bool = False
    dropped: bool = False


class ChangeSet(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that differs at one level.

    Attributes
    ----------
    lens : Folder of the lens.
    base : What it stands on.
    continues : The version of this level that the last edit was made to; None for the
        first of a level.
    changes : Oldest first.
    """

    schema: Literal["lensfit.change_set.1"] = "lensfit.change_set.1"
    lens: str
    base: Base
    continues: str | None
    changes: Annotated[tuple[Change, ...], Meta(min_length=1)]

    def effective_changes(self) -> dict[str, Change]:
        """The last change of every key that is still changed, in the order made."""
        last: dict[str, Change] = {}
        for change in self.changes:
            last.pop(change.key, None)
            if not change.dropped:
                last[change.key] = change
        return last


def is_change_set(tables: dict[str, Any]) -> bool:
    """Whether a file says that it is one, of whatever version."""
    return str(tables.get("schema")).startswith(f"lensfit.{KIND}.")


def change_set_of_tables(tables: dict[str, Any], where: str | Path) -> ChangeSet:
    """A change set from what stands in its file; checked.

    Raises
    ------
    PresetError : It is no change set, or changes what is locked.
    """
    check_version(tables, where, kind=KIND, current_version=1)
    for key, value in non_finite_numbers(tables):
        raise PresetError(f"{key}: {value} is no finite number", where=where)
    found = convert_strictly(tables, ChangeSet, error=PresetError, where=where)
    changes = tuple(map(_upgraded_change, found.changes))
    found = msgspec.structs.replace(found, changes=changes)
    versions = [v for v in (found.base.version, found.continues) if v is not None]
    for version in versions:
        if version_number(version) is None:
            raise PresetError(f"{version[:40]!r} is no version", where=where)
    if not is_slug(found.lens):
        raise PresetError(f"{found.lens[:40]!r} is no folder of a lens", where=where)
    for index, change in enumerate(found.changes):
        try:
            _check_change(change)
        except PresetError as fault:
            raise PresetError(
                f"changes[{index}]: {fault.what}", where=where, remedy=fault.remedy
            ) from fault
    return found


def _upgraded_change(change: Change) -> Change:
    """A change may have been made to a preset of an older schema."""
    return msgspec.structs.replace(
        change,
        key=key_with_pupil_shift(change.key),
        value=with_pupil_shift(change.value),
        before=with_pupil_shift(change.before),
    )


def _check_change(change: Change) -> None:
    check_lock(change.key, steps_of(change.key), unlocked=change.unlocked)
    for name in ("who", "why"):
        if not getattr(change, name).strip():
            raise PresetError(f"{name} is empty", remedy="every edit says who and why")
    try:
        aware = datetime.fromisoformat(change.when).tzinfo is not None
    except ValueError:
        aware = False
    if not aware:
        raise PresetError(
            f"when: {change.when[:40]!r} is no date and time with its zone",
            remedy="write it as 2025-01-31T12:00:00+00:00",
        )


def change_set_text(changes: ChangeSet) -> str:
    """What a file of it holds.

    Raises
    ------
    PresetError : It holds what reading would refuse.
    """
    tables = msgspec.to_builtins(changes)
    change_set_of_tables(tables, changes.lens)
    return to_json_text(tables)

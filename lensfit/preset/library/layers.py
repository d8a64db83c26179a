"""Apply change sets to a whole preset, outermost first, so that the nearest level wins.

A change set is based on a version of its own level or on the result of the next level
outwards, and so on until a whole preset is met, which hides what lies further out.

An edit drops the standard deviations of the numbers it changes: a number set by hand
was not measured. What is found knows where each part of it came from.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from lensfit.errors import PresetError
from lensfit.preset.library.change_set import Change, ChangeSet
from lensfit.preset.library.key_path import (
    MISSING,
    Step,
    Tables,
    complete_tables,
    steps_of,
    value_at,
    with_value,
)
from lensfit.preset.library.levels import now
from lensfit.preset.library.shelf import Shelf
from lensfit.preset.library.versions import version_name, version_number
from lensfit.preset.schema import Preset, Saved
from lensfit.preset.store import preset_of_tables


class Part(NamedTuple):
    """A version that a preset was put together from."""

    level: str
    version: str
    path: Path


class Override(NamedTuple):
    """A key whose value comes from a change set.

    Attributes
    ----------
    change : The edit.
    beneath : The value that the preset below has.
    part : Where the edit stands.
    """

    change: Change
    beneath: Any
    part: Part

    def __str__(self) -> str:
        c, p = self.change, self.part
        return (
            f"{c.key} = {value_text(c.value)} (was {value_text(self.beneath)}) at "
            f"{p.level} {p.version} by {c.who}, {c.when}: {c.why}"
        )


@dataclass(frozen=True)
class FoundPreset:
    """A preset and where it came from.

    Attributes
    ----------
    name : ``takumar@v002``, or the path that was given.
    path : The file; of a library, the version's.
    parts : Nearest first, the whole preset last; empty for a file outside a library.
    overrides : Keys that change sets decided, by key.
    notes : What the user should know, one sentence each.
    """

    preset: Preset
    name: str
    path: Path
    parts: tuple[Part, ...] = ()
    overrides: tuple[Override, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def full_name(self) -> str:
        """With its level, as it may be typed: ``project:takumar@v002``."""
        return f"{self.parts[0].level}:{self.name}" if self.parts else self.name

    def taken_out(self, who: str) -> Preset:
        """The preset as it leaves the library: with its origin and edits on record."""
        origin = self.name
        if self.parts:
            origin = " on ".join(f"{p.level} {p.version}" for p in self.parts)
            origin = f"{self.name} ({origin})"
        saved = Saved(
            who, now(), origin=origin, edits=tuple(str(o) for o in self.overrides)
        )
        return msgspec.structs.replace(self.preset, saved=saved)


def value_text(value: Any) -> str:
    """A value for people."""
    if value is MISSING:
        return "not there"
    if isinstance(value, float):
        return f"{value:.10g}"
    text = msgspec.json.encode(value).decode()
    return text if len(text) <= 60 else f"{text[:57]}..."


_DEPTH = {"distortion": 2, "lateral_colour": 3, "fall_off": 4}
"""Steps down to the table whose covariance speaks of a block's numbers."""
_PROJECTION = ("principal_distance_mm", "principal_point_mm")


def without_stale_covariance(tables: Tables, steps: tuple[Step, ...]) -> Tables:
    """The tables without the covariance of numbers among which one was changed.

    Parameters
    ----------
    steps : To the number. A block that was put in whole keeps what it says of itself.
    """
    if steps[0] != "entries" or len(steps) < 3:
        return tables
    block, below = str(steps[2]), steps[3:]
    depth = _DEPTH.get(block, 0)
    if block == "projection" and (not below or below[0] in _PROJECTION):
        depth = 2
    if not depth or len(steps) <= depth:
        return tables
    place = (*steps[:depth], "covariance")
    if value_at(tables, place) in (None, MISSING):
        return tables
    return with_value(tables, place, None)


class Layer(NamedTuple):
    """A change set and where it stands."""

    part: Part
    changes: ChangeSet


def put_together(shelves: list[Shelf], number: int) -> FoundPreset:
    """A version of the first shelf, with all that it stands on.

    Raises
    ------
    PresetError : Something of it is missing, or cannot be what it is.
    """
    base, part, layers = _gathered(shelves, number)
    return found_of(shelves[0].slug, base, part, layers)


def put_beneath(
    shelves: list[Shelf], number: int, changes: ChangeSet
) -> tuple[list[Shelf], int]:
    """The shelves and the version that a change set stands on.

    Parameters
    ----------
    shelves : That of the change set, then those further out.
    number : Its version.

    Raises
    ------
    PresetError : It stands on nothing.
    """
    base = changes.base
    requested = None if base.version is None else version_number(base.version)
    if base.level == "outer":
        if len(shelves) < 2:
            raise PresetError(
                "changes a preset of an outer level, where there is none",
                where=shelves[0].path(number),
                remedy="save the lens at the project, and mark the project's folder "
                "with: lensfit preset project FOLDER",
            )
        outer = shelves[1]
        below = outer.in_use() if requested is None else outer.existing(requested)
        return shelves[1:], below
    if requested is None or requested >= number:
        raise PresetError(
            "stands on no earlier version of its own level",
            where=shelves[0].path(number),
            remedy="restore the file",
        )
    return shelves, shelves[0].existing(requested)


def _gathered(shelves: list[Shelf], number: int) -> tuple[Preset, Part, list[Layer]]:
    """The whole preset at the bottom, its place, and what lies on it, nearest first."""
    layers: list[Layer] = []
    while True:
        shelf = shelves[0]
        part = Part(shelf.level.label, version_name(number), shelf.path(number))
        found = shelf.read(number)
        if isinstance(found, Preset):
            return found, part, layers
        layers.append(Layer(part, found))
        shelves, number = put_beneath(shelves, number, found)


def with_layer(shelves: list[Shelf], number: int, changes: ChangeSet) -> FoundPreset:
    """What a version would be, were it these changes.

    Raises
    ------
    PresetError : The result would be no preset.
    """
    shelf = shelves[0]
    part = Part(shelf.level.label, version_name(number), shelf.path(number))
    base, bottom, layers = _gathered(*put_beneath(shelves, number, changes))
    return found_of(shelf.slug, base, bottom, [Layer(part, changes), *layers])


def found_of(slug: str, base: Preset, bottom: Part, layers: list[Layer]) -> FoundPreset:
    """A preset with its layers of changes, nearest first."""
    preset, overrides, notes = _changed(base, layers)
    parts = (*(layer.part for layer in layers), bottom)
    return FoundPreset(
        preset,
        f"{slug}@{parts[0].version}",
        parts[0].path,
        parts,
        tuple(overrides.values()),
        tuple(notes),
    )


def _changed(
    base: Preset, layers: list[Layer]
) -> tuple[Preset, dict[str, Override], list[str]]:
    """The preset with all changes, outermost first, so that the nearest wins."""
    if not layers:
        return base, {}, []
    tables: Tables = complete_tables(base)
    overrides: dict[str, Override] = {}
    notes: list[str] = []
    for part, changes in reversed(layers):
        first: dict[str, Change] = {}
        for change in changes.changes:
            first.setdefault(change.key, change)
        below = tables
        for key, change in changes.effective_changes().items():
            beneath = _value_at(below, key, part)
            if _is_other(beneath, first[key].before):
                notes.append(
                    f"{key} was {value_text(first[key].before)} when {part.level} "
                    f"{part.version} changed it and is {value_text(beneath)} beneath it"
                )
            steps = steps_of(key)
            tables = with_value(tables, steps, change.value)
            tables = without_stale_covariance(tables, steps)
            overrides = {k: o for k, o in overrides.items() if not _is_below(k, key)}
            overrides[key] = Override(change, beneath, part)
    return preset_of_tables(tables, layers[0].part.path), overrides, notes


def _is_other(value: Any, stated: Any) -> bool:
    return (None if value is MISSING else value) != stated


def _is_below(key: str, above: str) -> bool:
    return key == above or key.startswith((f"{above}.", f"{above}["))


def _value_at(tables: Tables, key: str, part: Part) -> Any:
    try:
        return value_at(tables, steps_of(key))
    except PresetError as fault:
        raise PresetError(
            f"changes {key}, which the preset beneath does not have",
            where=part.path,
            remedy="give the key back with: lensfit preset edit --drop KEY",
        ) from fault

"""Presets by path or name: change sets applied to a whole one, the nearest level last.

A change set is based on a version of its own level or on the result of the next level
outwards, and so on until a whole preset is met, which hides what lies further out.

An edit drops the standard deviations of the numbers it changes: a number set by hand
was not measured. What is found knows where each part of it came from.

A name is looked up at the levels of a library. Alone, or with "latest" or "default", it
means the nearest level that holds the lens. Versions are counted at each level by
itself: v001 of the shot is not v001 of the project. ``takumar@v001`` is that of the
nearest level which has one; ``project:takumar@v001`` says which level is meant.

A file of a library, or the folder of a lens in one, is read with the levels around it,
wherever one stands.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from lensfit._strict import did_you_mean
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
from lensfit.preset.library.levels import (
    LENSES,
    Level,
    levels_of,
    now,
    requested_slug,
    requested_version,
    version_name,
    version_number,
)
from lensfit.preset.library.shelf import Shelf, known_slugs, read_version, shelves_of
from lensfit.preset.schema import Preset, Saved
from lensfit.preset.store import load_preset, preset_of_tables


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
    base, part, layers = _base_and_layers(shelves, number)
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


def _base_and_layers(
    shelves: list[Shelf], number: int
) -> tuple[Preset, Part, list[Layer]]:
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
    base, bottom, layers = _base_and_layers(*put_beneath(shelves, number, changes))
    return found_of(shelf.slug, base, bottom, [Layer(part, changes), *layers])


def found_of(slug: str, base: Preset, bottom: Part, layers: list[Layer]) -> FoundPreset:
    """A preset with its layers of changes, nearest first."""
    preset, overrides, notes = _changed_preset(base, layers)
    parts = (*(layer.part for layer in layers), bottom)
    return FoundPreset(
        preset,
        f"{slug}@{parts[0].version}",
        parts[0].path,
        parts,
        tuple(overrides.values()),
        tuple(notes),
    )


def _changed_preset(
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
        return _preset_of_file(path)
    whole = Path(os.path.abspath(path))
    if _is(whole, os.path.isdir) and whole.parent.name == LENSES:
        levels, slug = levels_of(whole.parents[1]), whole.name
        shelves = _shelves(levels, lens_in(levels, slug))
        return put_together(shelves, shelves[0].in_use())
    if path.suffix == ".json" or path.is_absolute() or ".." in path.parts:
        return FoundPreset(load_preset(path), str(path), path)  # says what is wrong
    return _preset_of_name(
        str(text), levels_of(None if library is None else Path(library))
    )


def _preset_of_name(text: str, levels: tuple[Level, ...]) -> FoundPreset:
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
        return _nearest_version(_shelves(levels, lens_in(levels, name)), requested)
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


def _nearest_version(shelves: list[Shelf], requested: str) -> FoundPreset:
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


def _preset_of_file(path: Path) -> FoundPreset:
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

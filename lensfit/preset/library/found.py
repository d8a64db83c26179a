"""A preset and where each part of it came from."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from lensfit.preset.library.change_set import Change
from lensfit.preset.library.key_path import MISSING
from lensfit.preset.library.levels import now
from lensfit.preset.schema import Preset, Saved


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

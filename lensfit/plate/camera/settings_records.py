"""The tables of a settings file, key by key, and what they may hold."""

import math
from pathlib import Path
from typing import Any

import msgspec

from lensfit._strict import did_you_mean
from lensfit.errors import CameraError, ImageError, SettingsError
from lensfit.io.camera.header_entries import ALIASES, Alias
from lensfit.io.camera.quantity import LENGTHS_MM, TEXTS, checked_quantity
from lensfit.io.sequence import is_in_frames

QUANTITIES = (
    "focal_length_mm",
    "f_number",
    "t_number",
    "focus_distance_mm",
    "sensor_width_mm",
    "sensor_height_mm",
)


class CameraValues(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``[camera]``."""

    focal_length_mm: float | None = None
    f_number: float | None = None
    t_number: float | None = None
    focus_distance_mm: float | None = None
    sensor_width_mm: float | None = None
    sensor_height_mm: float | None = None


class FrameValues(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of ``[[frames]]``."""

    range: str | None = None
    at: list[int] | None = None
    focal_length_mm: float | list[float] | None = None
    f_number: float | list[float] | None = None
    t_number: float | list[float] | None = None
    focus_distance_mm: float | list[float] | None = None
    sensor_width_mm: float | list[float] | None = None
    sensor_height_mm: float | list[float] | None = None


class AliasEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of ``[aliases]`` with its unit."""

    key: str
    unit: str | None = None
    factor: float | None = None


_Aliases = str | AliasEntry | list[str | AliasEntry]


class SettingsFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A settings file as it is written."""

    aliases: dict[str, _Aliases] = {}
    camera: CameraValues = CameraValues()
    frames: list[FrameValues] = []
    knobs: dict[str, Any] = {}


def _check(name: str, value: float | None, path: Path, place: str) -> None:
    if value is None:
        return
    try:
        # Elsewhere 0 is "not known"; who writes it here means something else.
        if (
            math.isnan(value)
            or checked_quantity(name, value or -math.inf, place) is None
        ):
            raise CameraError(f"{place} is {value:g}, which is no number above zero")
    except CameraError:
        raise SettingsError(
            f"{place} is {value:g}, which it cannot be",
            where=path,
            remedy="give a number above zero, in the unit of its name",
        ) from None


def check_values(file: SettingsFile, path: Path) -> None:
    """Refuse numbers that no camera has, and frames that are none.

    Raises
    ------
    SettingsError : The sentence names the table and the key.
    """
    for name in QUANTITIES:
        _check(name, getattr(file.camera, name), path, f"[camera] {name}")
    for number, values in enumerate(file.frames, 1):
        _check_frames(values, path, f"[[frames]] {number}")


def aliases_of(file: SettingsFile, path: Path) -> dict[str, tuple[Alias, ...]]:
    """Header entries by quantity, with their factors.

    Raises
    ------
    SettingsError : A quantity or unit is unknown.
    """
    return {
        name: tuple(
            _alias(name, entry, path)
            for entry in (entries if isinstance(entries, list) else [entries])
        )
        for name, entries in file.aliases.items()
    }


def _check_frames(values: FrameValues, path: Path, place: str) -> None:
    keys = values.at
    if keys is not None and (not keys or keys != sorted(set(keys))):
        raise SettingsError(
            f"{place}: at must list rising frames",
            where=path,
            remedy="write each frame once, as at = [1001, 1020, 1050]",
        )
    if values.range is None and keys is None:
        raise SettingsError(
            f"{place} has no frames", where=path, remedy='add range = "1001-1050"'
        )
    if values.range is not None and keys is not None:
        raise SettingsError(
            f"{place} has both a range and at, and each says which frames it holds for",
            where=path,
            remedy="leave range out, and repeat the first and the last value at the "
            "ends of the range to hold them there",
        )
    if values.range is not None:
        try:
            is_in_frames(values.range, 0)
        except ImageError as error:
            raise SettingsError(
                f"{place}: {error.what}", where=path, remedy=error.remedy
            ) from None
    for name in QUANTITIES:
        value = getattr(values, name)
        listed = value if isinstance(value, list) else [value]
        if isinstance(value, list) and len(value) != len(keys or ()):
            raise SettingsError(
                f"{place}: {name} has {len(value)} values and at has "
                f"{len(keys or ())} frames",
                where=path,
                remedy="give one value for each frame of at",
            )
        for number in listed:
            _check(name, number, path, f"{place}: {name}")


def _alias(name: str, entry: str | AliasEntry, path: Path) -> Alias:
    if name not in ALIASES:
        raise SettingsError(
            f'[aliases]: "{name}" is no quantity; {did_you_mean(name, [*ALIASES])}',
            where=path,
            remedy="write it as a quantity and its header entry: "
            'focal_length_mm = "myrenderer/focal"',
        )
    if isinstance(entry, str):
        entry = AliasEntry(entry)
    place = f"[aliases] {name}"
    if not entry.key.strip():
        raise SettingsError(
            f"{place}: an entry has no name",
            where=path,
            remedy='name the header entry, as "myrenderer/focal"',
        )
    place = f'{place}, "{entry.key}"'
    if entry.unit is None and entry.factor is None:
        return Alias(entry.key)
    if name in TEXTS or (entry.unit is not None and entry.factor is not None):
        what = "is text and has neither unit nor factor"
        raise SettingsError(
            f"{place}: " + (what if name in TEXTS else "has both a unit and a factor"),
            where=path,
            remedy="leave them out" if name in TEXTS else "leave one of them out",
        )
    if entry.factor is not None:
        if not 0 < entry.factor < math.inf:
            raise SettingsError(
                f"{place}: factor is {entry.factor:g} and must be above zero",
                where=path,
                remedy=f"give what its number is multiplied by to be {_unit(name)}",
            )
        return Alias(entry.key, entry.factor)
    factor = LENGTHS_MM.get(str(entry.unit)) if name.endswith("_mm") else None
    if factor is None:
        lengths = name.endswith("_mm")
        raise SettingsError(
            f'{place}: "{entry.unit}" is no unit of it',
            where=path,
            remedy=f"give one of {', '.join(LENGTHS_MM)}, or a factor"
            if lengths
            else "leave the unit out, or give a factor",
        )
    return Alias(entry.key, factor)


def _unit(name: str) -> str:
    """What the number of a quantity counts, as its name says."""
    return "mm" if name.endswith("_mm") else f"the {name.replace('_', ' ')}"

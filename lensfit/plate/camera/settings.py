"""Settings of a project, a sequence or a shot: `lensfit.toml` beside the plates.

The file is looked for in the plate's folder and every folder above it. Each key counts
from the nearest file that has it, so that a shot states its own values and the project
the rest. A file that is named with ``--settings`` stands alone. Tables:

``[camera]``   values for all frames: focal_length_mm, f_number, t_number,
               focus_distance_mm, sensor_width_mm, sensor_height_mm
``[[frames]]`` the same for a ``range``; of several that have a frame the last counts.
               Between key frames (``at = [1001, 1050]``, in place of a range) values
               may be lists of the same length: focal length and stops are interpolated
               linearly from key to key, focus in dioptres.
``[aliases]``  header entries of other renderers, by quantity
``[knobs]``    knobs by name; they are checked where they are applied to the preset
"""

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, final

import msgspec

from lensfit._strict import (
    array_table_place,
    convert_strictly,
    did_you_mean,
    read_toml_tables,
)
from lensfit.errors import CameraError, ImageError, SettingsError
from lensfit.io.camera.header_entries import ALIASES, Alias
from lensfit.io.camera.quantity import LENGTHS_MM, TEXTS, Reading, checked_quantity
from lensfit.io.sequence import is_in_frames
from lensfit.preset.blend import blended_distance_mm, interpolated_number

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


NAME = "lensfit.toml"


class _Level(NamedTuple):
    """One file, checked."""

    path: Path
    file: SettingsFile
    aliases: dict[str, tuple[Alias, ...]]


@final
@dataclass(frozen=True)
class Settings:
    """What the settings files say, the nearest first.

    Attributes
    ----------
    paths : The files.
    aliases : Header entries by quantity.
    knobs : Of all files, joined key by key; not checked.
    knob_paths : The file that each knob came from.
    """

    paths: tuple[Path, ...] = ()
    aliases: Mapping[str, tuple[Alias, ...]] = field(default_factory=dict)
    knobs: Mapping[str, Any] = field(default_factory=dict)
    knob_paths: Mapping[str, Path] = field(default_factory=dict)
    levels: tuple[_Level, ...] = ()

    def camera_at(self, frame: int | None) -> Iterator[tuple[str, Reading]]:
        """What is said of a frame, the word that counts most first.

        Parameters
        ----------
        frame : Its number; None leaves ``[[frames]]`` out.
        """
        for level in self.levels:
            for number, values in reversed([*enumerate(level.file.frames, 1)]):
                if frame is None or not _has(values, frame):
                    continue
                for name in QUANTITIES:
                    value = _value_at(values, name, frame)
                    if value is not None:
                        yield name, Reading(value, f"{level.path} [[frames]] {number}")
        for level in self.levels:
            for name in QUANTITIES:
                value = getattr(level.file.camera, name)
                if value is not None:
                    yield name, Reading(value, f"{level.path} [camera]")


def settings_beside(folder: str | Path) -> Settings:
    """The settings that hold for plates of a folder.

    Raises
    ------
    SettingsError : One of the files is malformed.
    """
    folder = Path(folder).absolute()
    found = [place / NAME for place in (folder, *folder.parents)]
    return _joined_settings([path for path in found if path.is_file()])


def load_settings(path: str | Path) -> Settings:
    """The settings of one file.

    Raises
    ------
    SettingsError : The file cannot be read or is malformed; the sentence names the key.
    """
    return _joined_settings([Path(path)])


def _joined_settings(paths: Sequence[Path]) -> Settings:
    levels = tuple(_level(path, file_stamp(path)) for path in paths)
    aliases: dict[str, tuple[Alias, ...]] = {}
    knobs: dict[str, Any] = {}
    knob_paths: dict[str, Path] = {}
    for level in reversed(levels):
        aliases |= level.aliases
        knobs |= level.file.knobs
        knob_paths |= dict.fromkeys(level.file.knobs, level.path)
    return Settings(tuple(paths), aliases, knobs, knob_paths, levels)


def file_stamp(path: Path) -> tuple[int, int] | None:
    """Changes with the file, so that one that was edited is read again."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size


@lru_cache(maxsize=64)
def _level(path: Path, stamp: tuple[int, int] | None) -> _Level:
    del stamp  # part of the key alone: an edited file has another
    remedy = "notebooks/guide/camera_and_farm.md describes settings files"
    data = read_toml_tables(path, error=SettingsError, source=remedy, mend=remedy)
    try:
        file = convert_strictly(
            data, SettingsFile, error=SettingsError, where=path, place=array_table_place
        )
    except SettingsError as error:
        raise SettingsError(error.what, where=path, remedy=remedy) from error
    check_values(file, path)
    return _Level(path, file, aliases_of(file, path))


def _has(values: FrameValues, frame: int) -> bool:
    if values.range is not None:
        return is_in_frames(values.range, frame)
    keys = values.at or [math.inf]
    return keys[0] <= frame <= keys[-1]


def _value_at(values: FrameValues, name: str, frame: int) -> float | None:
    value = getattr(values, name)
    if not isinstance(value, list):
        return value
    keys = values.at or []
    after = bisect_right(keys, frame)
    if after == len(keys):
        return value[-1]
    low, high = value[after - 1], value[after]
    share = (frame - keys[after - 1]) / (keys[after] - keys[after - 1])
    mean = blended_distance_mm if name == "focus_distance_mm" else interpolated_number
    return mean(low, high, share)

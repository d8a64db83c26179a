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

from lensfit._strict import array_table_place, convert_strictly, read_toml_tables
from lensfit.errors import SettingsError
from lensfit.io.camera.header_entries import Alias
from lensfit.io.camera.quantity import Reading
from lensfit.io.sequence import is_in_frames
from lensfit.plate.camera.settings_records import (
    QUANTITIES,
    FrameValues,
    SettingsFile,
    aliases_of,
    check_values,
)
from lensfit.preset.blend import blended, blended_distance_mm

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
    return _joined([path for path in found if path.is_file()])


def load_settings(path: str | Path) -> Settings:
    """The settings of one file.

    Raises
    ------
    SettingsError : The file cannot be read or is malformed; the sentence names the key.
    """
    return _joined([Path(path)])


def _joined(paths: Sequence[Path]) -> Settings:
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
    mean = blended_distance_mm if name == "focus_distance_mm" else blended
    return mean(low, high, share)

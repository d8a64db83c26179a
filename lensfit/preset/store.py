"""Presets on disk: read strictly, written whole, and never written unreadable."""

import json
from pathlib import Path
from typing import Any

import msgspec

from lensfit._strict import convert_strictly, non_finite_numbers
from lensfit.atomic import write_text_atomic
from lensfit.errors import PresetError
from lensfit.preset.check import check_preset
from lensfit.preset.json_text import (
    infinities_from_text,
    infinities_to_text,
    to_json_text,
)
from lensfit.preset.schema import Preset
from lensfit.preset.upgrade import upgrade


def load_preset(path: str | Path) -> Preset:
    """Read a preset, of this or an older schema.

    Parameters
    ----------
    path : A ``preset.json`` that `lensfit calibrate` wrote.

    Raises
    ------
    PresetError : It cannot be read, is no preset, or holds something a preset may not;
        the sentence names the key.
    """
    path = Path(path)
    return _from_tables(upgrade(_tables(path), path), path)


def save_preset(preset: Preset, path: str | Path) -> None:
    """Write a preset as JSON, whole or not at all.

    Raises
    ------
    PresetError : The preset holds what `load_preset` would refuse, such as a NaN.
    OutputError : The file cannot be written.
    """
    tables = infinities_to_text(msgspec.to_builtins(preset))
    _from_tables(tables, Path(path))
    write_text_atomic(path, to_json_text(tables))


def _from_tables(tables: dict[str, Any], path: Path) -> Preset:
    for key, value in non_finite_numbers(tables):
        raise PresetError(
            f"{key}: {value} is no finite number",
            where=path,
            remedy='only a focus or reference distance may be infinite, written "inf"',
        )
    preset = convert_strictly(
        infinities_from_text(tables), Preset, error=PresetError, where=path
    )
    check_preset(preset, path)
    return preset


def _tables(path: Path) -> dict[str, Any]:
    try:
        tables = json.loads(path.read_bytes(), object_pairs_hook=_without_duplicates)
    except OSError as error:
        raise PresetError(
            f"cannot be read ({error.strerror})",
            where=path,
            remedy='give a preset.json that "lensfit calibrate" wrote',
        ) from error
    except (ValueError, RecursionError) as error:
        raise PresetError(
            f"is not valid JSON: {error}", where=path, remedy="restore or mend the file"
        ) from error
    if not isinstance(tables, dict):
        raise PresetError("is JSON but no preset", where=path)
    return tables


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    tables = dict(pairs)
    if len(tables) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f'key "{twice}" stands twice in one object')
    return tables

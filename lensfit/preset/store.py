"""Read presets strictly; write them whole, after a check that they read back."""

from pathlib import Path
from typing import Any

import msgspec

from lensfit._strict import (
    convert_strictly,
    non_finite_numbers,
    read_json_object,
)
from lensfit.atomic import write_text_atomic
from lensfit.errors import PresetError
from lensfit.preset.json_text import (
    infinities_from_text,
    infinities_to_text,
    to_json_text,
)
from lensfit.preset.preset_faults import check_preset
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
    tables = read_json_object(
        path,
        error=PresetError,
        source='give a preset.json that "lensfit calibrate" wrote',
        mend="restore or mend the file",
    )
    return preset_of_tables(upgrade(tables, path), path)


def save_preset(preset: Preset, path: str | Path) -> None:
    """Write a preset as JSON, whole or not at all.

    Raises
    ------
    PresetError : The preset holds what `load_preset` would refuse, such as a NaN.
    OutputError : The file cannot be written.
    """
    write_text_atomic(path, preset_text(preset, path))


def preset_text(preset: Preset, where: str | Path) -> str:
    """What a file of the preset holds.

    Raises
    ------
    PresetError : The preset holds what `load_preset` would refuse.
    """
    # As it would be read: a whole number where a length belongs is written as 50.0.
    read_back = preset_of_tables(preset_tables(preset), where)
    return to_json_text(preset_tables(read_back))


def preset_tables(preset: Preset) -> dict[str, Any]:
    """The preset as it stands in a file; knobs only if one is not neutral."""
    tables = infinities_to_text(msgspec.to_builtins(preset))
    for key in ("knobs", "saved", "verdict"):
        if not tables[key]:
            del tables[key]
    return tables


def preset_of_tables(tables: dict[str, Any], where: str | Path) -> Preset:
    """A preset from what stands in its file, of the present schema; checked.

    Raises
    ------
    PresetError : As `load_preset`; the sentence names `where` and the key.
    """
    for key, value in non_finite_numbers(tables):
        raise PresetError(
            f"{key}: {value} is no finite number",
            where=where,
            remedy='only a focus or reference distance may be infinite, written "inf"',
        )
    preset = convert_strictly(
        infinities_from_text(tables), Preset, error=PresetError, where=where
    )
    try:
        check_preset(preset, where)
    except ArithmeticError as reason:
        raise PresetError(
            "holds numbers too large or too small for any lens",
            where=where,
            remedy="restore or mend the file",
        ) from reason
    return preset

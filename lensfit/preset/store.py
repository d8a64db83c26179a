"""Read presets strictly, older ones upgraded; write whole ones that read back.

Older presets are upgraded one version at a time. Each step takes the plain tables of
version n and returns those of version n + 1; it sets the schema itself. A step that
cannot keep some content of the older version raises a `PresetError` with the reason.

The JSON is laid out for readers, with every number kept to the bit. Numbers are written
as the shortest decimal that reads back as the same float64. Lists of plain values stay
on one line, as do short objects; longer lists are filled lines, so that a diff shows
where a change is. Keys keep the order of the schema. JSON has no infinity, so an
infinite distance is the text "inf".
"""

import json
import math
import re
from collections.abc import Callable, Mapping
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
from lensfit.preset.preset_faults import check_preset
from lensfit.preset.schema import Preset

Tables = dict[str, Any]
Step = Callable[[Tables], Tables]

CURRENT_VERSION = 2
_KEYS_OF_1 = {"pupil_walk": "pupil_shift", "walk_mm": "shift_mm"}
_TEXTS_OF_1 = {"pupil_walk": "pupil_shift", "pupil_walk_mm": "pupil_shift_mm"}
_NUMBERED = re.compile(r"(\w+)((?:\[\d+\])?)")


def with_renamed_keys(
    value: Any, keys: Mapping[str, str], texts: Mapping[str, str]
) -> Any:
    """Plain tables in which some keys and texts have other words, however deep.

    Parameters
    ----------
    texts : Of whole texts, which may end in a number in brackets.
    """
    if isinstance(value, dict):
        return {
            keys.get(k, k): with_renamed_keys(v, keys, texts) for k, v in value.items()
        }
    if isinstance(value, list):
        return [with_renamed_keys(item, keys, texts) for item in value]
    match = _NUMBERED.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        return value
    return texts.get(match[1], match[1]) + match[2]


def with_pupil_shift(value: Any) -> Any:
    """What version 1 called the walk of the pupil is its shift, in version 2."""
    return with_renamed_keys(value, _KEYS_OF_1, _TEXTS_OF_1)


def key_with_pupil_shift(key: str) -> str:
    """The same for a dotted key."""
    return ".".join(_KEYS_OF_1.get(part, part) for part in key.split("."))


def _step_from_1(tables: Tables) -> Tables:
    return with_pupil_shift(tables) | {"schema": "lensfit.preset.2"}


STEPS: dict[int, Step] = {1: _step_from_1}
"""The step that leads from each version to the next."""


def schema_name(version: int, kind: str = "preset") -> str:
    """ "lensfit.preset.2" and so on."""
    return f"lensfit.{kind}.{version}"


def check_version(
    tables: Tables,
    where: str | Path,
    *,
    kind: str = "preset",
    current_version: int = CURRENT_VERSION,
) -> int:
    """The version that a file states, which is not newer than this program.

    Parameters
    ----------
    tables : What stands in the file.
    where : The file, for messages.
    kind : Of file, as its schema names it.

    Raises
    ------
    PresetError : It is of another kind, or was written by a newer lensfit.
    """
    version = _version(tables, where, kind)
    if version > current_version:
        raise PresetError(
            f'has the schema "{tables["schema"]}", newer than '
            f'"{schema_name(current_version, kind)}"',
            where=where,
            remedy="update lensfit to read it",
        )
    return version


def upgrade(
    tables: Tables,
    where: str | Path,
    *,
    steps: Mapping[int, Step] = STEPS,
    current_version: int = CURRENT_VERSION,
) -> Tables:
    """`tables` in the present schema.

    Parameters
    ----------
    tables : What stands in a preset file; left as it is.
    where : The file, for messages.

    Raises
    ------
    PresetError : It is no preset, was written by a newer lensfit, or is too old.
    """
    version = check_version(tables, where, current_version=current_version)
    while version < current_version:
        if version not in steps:
            raise PresetError(
                f'has the schema "{tables["schema"]}", which is no longer read',
                where=where,
                remedy="calibrate again, or load it with an older lensfit",
            )
        tables = steps[version](dict(tables))
        version = _version(tables, where)
    return tables


def _version(tables: Tables, where: str | Path, kind: str = "preset") -> int:
    schema = tables.get("schema")
    match = re.fullmatch(rf"lensfit\.{kind}\.([1-9]\d{{0,5}})", str(schema), re.ASCII)
    if not match:
        words = kind.replace("_", " ")
        said = "has the schema " + repr(schema)[:80]
        raise PresetError(
            f"{'has no schema' if schema is None else said}, so it is no lensfit "
            f"{words}",
            where=where,
            remedy=f'a {words} begins with "schema": '
            f'"{schema_name(CURRENT_VERSION, kind)}"',
        )
    return int(match[1])


WIDTH = 88
INFINITE = "inf"
_MAY_BE_INFINITE = ("focus_distance_mm", "reference_distance_mm")


def to_json_text(value: Any) -> str:
    """`value` (plain tables, lists, text, finite numbers) as JSON, with a newline."""
    return _text(value, "") + "\n"


def infinities_to_text(value: Any) -> Any:
    """The same tables, with an infinite distance as "inf"."""
    return _map_distances(value, lambda v: INFINITE if v == math.inf else v)


def infinities_from_text(value: Any) -> Any:
    """Inverse of `infinities_to_text`."""
    return _map_distances(value, lambda v: math.inf if v == INFINITE else v)


def _map_distances(value: Any, change: Any, key: str = "") -> Any:
    if isinstance(value, dict):
        return {k: _map_distances(v, change, k) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_map_distances(v, change) for v in value]
    return change(value) if key in _MAY_BE_INFINITE else value


def _text(value: Any, indent: str, used: int = 0) -> str:
    flat = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if not isinstance(value, (dict, list, tuple)) or not value:
        return flat
    items = value.values() if isinstance(value, dict) else value
    plain = not any(isinstance(item, (dict, list, tuple)) for item in items)
    fits = len(indent) + used + len(flat) <= WIDTH
    if plain and fits:
        return flat
    inner = indent + "  "
    if isinstance(value, dict):
        opening, closing = "{", "}"
        names = [f"{json.dumps(name, ensure_ascii=False)}: " for name in value]
        lines = [
            inner + name + _text(item, inner, len(name) + 1)
            for name, item in zip(names, value.values(), strict=True)
        ]
    elif plain:
        return "[\n" + _filled_lines(value, inner) + "\n" + indent + "]"
    else:
        opening, closing = "[", "]"
        lines = [inner + _text(item, inner, 1) for item in value]
    return opening + "\n" + ",\n".join(lines) + "\n" + indent + closing


def _filled_lines(values: Any, indent: str) -> str:
    """Plain values, comma by comma, in lines as long as they may be."""
    lines = [indent]
    for index, value in enumerate(values):
        word = json.dumps(value, ensure_ascii=False, allow_nan=False)
        word += "," if index < len(values) - 1 else ""
        if len(lines[-1]) + len(word) + 1 > WIDTH and lines[-1] != indent:
            lines.append(indent)
        lines[-1] += word if lines[-1] == indent else f" {word}"
    return "\n".join(lines)


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

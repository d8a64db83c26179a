"""Upgrade older presets to the present schema, one version at a time.

Each step takes the plain tables of version n and returns those of version n + 1; it
sets the schema itself. A step that cannot keep some content of the older version raises
a `PresetError` with the reason.
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lensfit.errors import PresetError

Tables = dict[str, Any]
Step = Callable[[Tables], Tables]

CURRENT_VERSION = 2
_KEYS_OF_1 = {"pupil_walk": "pupil_shift", "walk_mm": "shift_mm"}
_TEXTS_OF_1 = {"pupil_walk": "pupil_shift", "pupil_walk_mm": "pupil_shift_mm"}
_NUMBERED = re.compile(r"(\w+)((?:\[\d+\])?)")


def renamed(value: Any, keys: Mapping[str, str], texts: Mapping[str, str]) -> Any:
    """Plain tables in which some keys and texts have other words, however deep.

    Parameters
    ----------
    texts : Of whole texts, which may end in a number in brackets.
    """
    if isinstance(value, dict):
        return {keys.get(k, k): renamed(v, keys, texts) for k, v in value.items()}
    if isinstance(value, list):
        return [renamed(item, keys, texts) for item in value]
    match = _NUMBERED.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        return value
    return texts.get(match[1], match[1]) + match[2]


def with_pupil_shift(value: Any) -> Any:
    """What version 1 called the walk of the pupil is its shift, in version 2."""
    return renamed(value, _KEYS_OF_1, _TEXTS_OF_1)


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

"""Keys of a preset as people write them, and the values they name.

``entries[focal_length_mm=50,focus_distance_mm=2000].distortion.squeeze``: names joined
by dots; of a list, one member by what it is (its identity) or by its number from 0. A
knob may be written by its name alone. All functions take plain tables as
`complete_tables` makes them and leave them as they are.
"""

import json
import math
import re
from typing import Any

import msgspec

from lensfit.errors import PresetError
from lensfit.preset.knobs import GROUP_OF
from lensfit.preset.store import infinities_to_text

Tables = dict[str, Any]
Pairs = tuple[tuple[str, str], ...]
Step = str | int | Pairs
"""A name, a number in a list, or the identity of a member."""

IDENTITY: dict[str, tuple[str, ...]] = {
    "entries": ("focal_length_mm", "focus_distance_mm"),
    "fall_off": ("f_number",),
    "stops": ("f_number",),
    "aberrations": ("degree", "order", "field_degree", "field_order", "part"),
    "terms": ("name",),
}
"""By which of its keys a member of a list is told from the others."""

MISSING = object()
"""The value of a key that is not there."""

_LONGEST = 400
_NAME, _MEMBER = r"[A-Za-z_][A-Za-z0-9_]*", r"\[[^\[\]]{1,200}\]"
_KEY = re.compile(rf"{_NAME}(?:\.{_NAME}|{_MEMBER})*")
_STEP = re.compile(rf"{_NAME}|{_MEMBER}")


def complete_tables(value: Any) -> Any:
    """A preset as plain tables, with every key that has a default too."""
    return infinities_to_text(_plain(value))


def _plain(value: Any) -> Any:
    if isinstance(value, msgspec.Struct):
        return {name: _plain(getattr(value, name)) for name in value.__struct_fields__}
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    return value


def steps_of(key: str) -> tuple[Step, ...]:
    """A key in steps; a knob's name alone becomes its whole key.

    Raises
    ------
    PresetError : It is no key.
    """
    if len(key) > _LONGEST or not _KEY.fullmatch(key):
        raise PresetError(
            f"{key[:80]!r} is no key",
            remedy="write it as entries[focal_length_mm=50].distortion.squeeze, "
            "or the name of a knob",
        )
    if key in GROUP_OF:
        return ("knobs", GROUP_OF[key], key)
    return tuple(
        _member(part[1:-1], key) if part.startswith("[") else part
        for part in _STEP.findall(key)
    )


def _member(text: str, key: str) -> int | Pairs:
    if text.isascii() and text.isdigit():
        return int(text[:9])
    pairs = [pair.partition("=") for pair in text.split(",")]
    if not all(name.strip() and value.strip() for name, _, value in pairs):
        raise PresetError(
            f"{key[:80]}: [{text[:40]}] names no member of a list",
            remedy="write [focal_length_mm=50], or its number from 0",
        )
    return tuple((name.strip(), value.strip()) for name, _, value in pairs)


def key_of(tables: Tables, steps: tuple[Step, ...]) -> str:
    """The key in its one spelling: members by their identity, where they have one.

    Raises
    ------
    PresetError : A member of a list is not there, or not the only one.
    """
    value: Any = tables
    key, before = "", ""
    for step in steps:
        if isinstance(step, str):
            key += f".{step}" if key else step
            value = value.get(step, MISSING) if isinstance(value, dict) else MISSING
            before = step
        else:
            index = _index(value, step, key)
            value = value[index]
            key += member_text(before, value, index)
    return key


def member_text(list_name: str, member: Any, index: int) -> str:
    """``[f_number=1.4]``, or ``[3]`` where members have no identity."""
    identity = IDENTITY.get(list_name, ())
    if not identity or not isinstance(member, dict):
        return f"[{index}]"
    return "[" + ",".join(f"{k}={_value_text(member[k])}" for k in identity) + "]"


def _value_text(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text.removesuffix(".0")


def _index(value: Any, step: int | Pairs, place: str) -> int:
    """Which member of a list is meant."""
    if not isinstance(value, list):
        raise PresetError(f"{place}: is no list here")
    if isinstance(step, int):
        if step >= len(value):
            raise PresetError(f"{place}[{step}]: there are {len(value)}, from 0")
        return step
    said = ",".join(f"{name}={text}" for name, text in step)
    found = [i for i, m in enumerate(value) if _is_meant(m, step)]
    if len(found) != 1:
        here = " ".join(
            member_text(place.rpartition(".")[2], m, i) for i, m in enumerate(value)
        )
        what = "is not there" if not found else "is not the only one"
        raise PresetError(f"{place}[{said}]: {what}", remedy=f"here are {here[:200]}")
    return found[0]


def _is_meant(member: Any, pairs: Pairs) -> bool:
    return isinstance(member, dict) and all(
        name in member and _is_equal(member[name], text) for name, text in pairs
    )


def _is_equal(value: Any, text: str) -> bool:
    if _value_text(value) == text:
        return True
    try:
        return isinstance(value, float | int) and math.isclose(value, float(text))
    except ValueError:
        return False


def value_at(tables: Tables, steps: tuple[Step, ...]) -> Any:
    """The value at a key; `MISSING` where the last names lead nowhere.

    Raises
    ------
    PresetError : A member of a list is not there, or not the only one.
    """
    value: Any = tables
    for at, step in enumerate(steps):
        if isinstance(step, str):
            value = value.get(step, MISSING) if isinstance(value, dict) else MISSING
        elif value is MISSING:
            return MISSING
        else:
            value = value[_index(value, step, _spelled_path(steps[:at]))]
    return value


def with_value(tables: Tables, steps: tuple[Step, ...], value: Any) -> Tables:
    """The tables with another value at a key; tables on the way there are made.

    Raises
    ------
    PresetError : A member of a list is not there, or a name stands below a number.
    """
    return _with(tables, steps, value, 0)


def _with(found: Any, steps: tuple[Step, ...], value: Any, at: int) -> Any:
    if at == len(steps):
        return value
    step = steps[at]
    if isinstance(step, str):
        if found is None or found is MISSING:
            found = {}
        if not isinstance(found, dict):
            raise PresetError(f"{_spelled_path(steps[:at])}: holds no keys")
        below = _with(found.get(step, MISSING), steps, value, at + 1)
        return {**found, step: below}
    index = _index(found, step, _spelled_path(steps[:at]))
    changed = list(found)
    changed[index] = _with(found[index], steps, value, at + 1)
    return changed


def _spelled_path(steps: tuple[Step, ...]) -> str:
    text = ""
    for step in steps:
        if isinstance(step, str):
            text += f".{step}" if text else step
        elif isinstance(step, int):
            text += f"[{step}]"
        else:
            text += "[" + ",".join(f"{name}={value}" for name, value in step) + "]"
    return text

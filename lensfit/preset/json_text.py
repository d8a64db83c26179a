"""Preset JSON laid out for readers, with every number kept to the bit.

Numbers are written as the shortest decimal that reads back as the same float64. Lists
of plain values stay on one line, as do short objects; longer lists are filled lines,
so that a diff shows where a change is. Keys keep the order of the schema. JSON has no
infinity, so an infinite distance is the text "inf".
"""

import json
import math
from typing import Any

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
        return "[\n" + _filled(value, inner) + "\n" + indent + "]"
    else:
        opening, closing = "[", "]"
        lines = [inner + _text(item, inner, 1) for item in value]
    return opening + "\n" + ",\n".join(lines) + "\n" + indent + closing


def _filled(values: Any, indent: str) -> str:
    """Plain values, comma by comma, in lines as long as they may be."""
    lines = [indent]
    for index, value in enumerate(values):
        word = json.dumps(value, ensure_ascii=False, allow_nan=False)
        word += "," if index < len(values) - 1 else ""
        if len(lines[-1]) + len(word) + 1 > WIDTH and lines[-1] != indent:
            lines.append(indent)
        lines[-1] += word if lines[-1] == indent else f" {word}"
    return "\n".join(lines)

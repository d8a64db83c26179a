"""Set keys of a TOML file line by line, without changing the rest of it.

Lines of the file stay as they are, comments too: an existing key gets another value,
others are added below the head of their table. The new text is parsed, and only taken
if it equals the old file with these changes and nothing else.
"""

import copy
import json
import re
import tomllib
from collections.abc import Mapping
from typing import Any

_HEAD = re.compile(r"\s*\[")
_TODO = "TODO"


def toml_value(value: object) -> str:
    """A value as TOML writes it; JSON's strings are TOML's too, and repr writes inf as
    TOML does."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return f"[{', '.join(map(toml_value, value))}]"
    return repr(value)


def with_keys(
    text: str, table: str, values: Mapping[str, Any], place: int | None = None
) -> str | None:
    """The text with keys of a table set; None where they cannot be set line by line.

    A comment that says TODO goes with the value that it asked about.

    Parameters
    ----------
    values : None takes a key away.
    place : Of the table in its list, from 0, where there are many of the name.
    """
    wanted = copy.deepcopy(tomllib.loads(text))
    own = _table_of(wanted, table, place)
    if own is None:
        return None
    for key, value in values.items():
        own.pop(key, None)
        if value is not None:
            own[key] = value
    return _if_it_says(wanted, _with_lines(text, table, values, place))


def with_table(text: str, table: str, lines: str) -> str | None:
    """The text with one more table of a list at its end.

    Parameters
    ----------
    lines : Of the table, its head included.
    """
    wanted = copy.deepcopy(tomllib.loads(text))
    added = tomllib.loads(lines)[table]
    listed = wanted.setdefault(table, [])
    if not isinstance(listed, list):
        return None
    listed.extend(added)
    gap = "\n\n" if text.strip() else ""
    return _if_it_says(wanted, text.rstrip("\n") + gap + lines.rstrip("\n") + "\n")


def without_table(text: str, table: str, place: int) -> str | None:
    """The text without a table of a list."""
    wanted = copy.deepcopy(tomllib.loads(text))
    listed = wanted.get(table)
    if not isinstance(listed, list) or place >= len(listed):
        return None
    del listed[place]
    if not listed:
        del wanted[table]
    lines = _lines(text)
    span = _span(lines, table, place)
    if span is None:
        return None
    del lines[span[0] : span[1]]
    return _if_it_says(wanted, "\n".join(lines) + "\n")


def _table_of(
    tables: dict[str, Any], table: str, place: int | None
) -> dict[str, Any] | None:
    if place is None:
        found = tables.setdefault(table, {})
        return found if isinstance(found, dict) else None
    listed = tables.get(table)
    if not isinstance(listed, list) or place >= len(listed):
        return None
    return listed[place]


def _if_it_says(wanted: dict[str, Any], text: str | None) -> str | None:
    if text is None:
        return None
    try:
        return text if tomllib.loads(text) == wanted else None
    except tomllib.TOMLDecodeError:
        return None


def _lines(text: str) -> list[str]:
    return text.rstrip("\n").split("\n") if text.strip() else []


def _span(lines: list[str], table: str, place: int | None) -> tuple[int, int] | None:
    """First line of a table, its head, and the line after its last."""
    brackets = (r"\[", r"\]") if place is None else (r"\[\[", r"\]\]")
    head = re.compile(
        rf"\s*{brackets[0]}\s*{re.escape(table)}\s*{brackets[1]}\s*(#.*)?$"
    )
    heads = [i for i, line in enumerate(lines) if head.match(line)]
    if len(heads) <= (place or 0):
        return None
    start = heads[place or 0]
    later = (i for i in range(start + 1, len(lines)) if _HEAD.match(lines[i]))
    return start, next(later, len(lines))


def _with_lines(
    text: str, table: str, values: Mapping[str, Any], place: int | None
) -> str | None:
    lines = _lines(text)
    span = _span(lines, table, place)
    if span is None:
        if place is not None:
            return None
        gap = [""] if lines and lines[-1].strip() else []
        new = [f"{k} = {toml_value(v)}" for k, v in values.items() if v is not None]
        return "\n".join([*lines, *gap, f"[{table}]", *new]) + "\n"
    start, end = span
    added, gone = [], []
    for key, value in values.items():
        line = _line_of(key, lines, start, end)
        if value is None:
            gone += [] if line is None else [line]
            continue
        said = f"{key} = {toml_value(value)}"
        if line is None:
            added.append(said)
        else:
            lines[line] = said + _comment(lines[line])
    for line in sorted(gone, reverse=True):
        del lines[line]
    lines[start + 1 : start + 1] = added
    return "\n".join(lines) + "\n"


def _line_of(key: str, lines: list[str], start: int, end: int) -> int | None:
    own = re.compile(rf"""\s*["']?{re.escape(key)}["']?\s*=""")
    return next((i for i in range(start + 1, end) if own.match(lines[i])), None)


def _comment(line: str) -> str:
    """What is said after a value; of text in quotes, a # belongs to the value."""
    bare = re.sub(r"\"(?:\\.|[^\"\\])*\"|'[^']*'", "", line)
    _, mark, said = bare.partition("#")
    return f"  #{said}" if mark and _TODO not in said else ""

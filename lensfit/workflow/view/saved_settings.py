"""What was turned, put into a settings file without touching the rest of it.

Lines of the file stay as they are, comments too: a key that is there gets another
value, others are added below the head of their table. The new text is read back, and
only taken if it says the old file with these changes and nothing else; a file written
in a way that this does not understand is left alone.
"""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path

from lensfit.atomic import write_text_atomic
from lensfit.errors import SettingsError
from lensfit.workflow.camera.settings import load_settings
from lensfit.workflow.view.turned import number_text

Tables = Mapping[str, Mapping[str, float]]
_HEAD = re.compile(r"\s*\[")


def save_settings(path: Path, changes: Tables) -> None:
    """Set keys of a settings file, which is made if it is not there; whole or not.

    Parameters
    ----------
    changes : Table, key and value.

    Raises
    ------
    SettingsError : The file is malformed, or is written so that its keys cannot be set.
    OutputError : It cannot be written.
    """
    old = ""
    if path.is_file():
        load_settings(path)  # what is malformed is refused in its own words
        old = path.read_text(encoding="utf-8")
    write_text_atomic(path, changed_text(old, changes, path))


def changed_text(old: str, changes: Tables, path: Path) -> str:
    """The text of a settings file with other values.

    Raises
    ------
    SettingsError : Its keys cannot be set line by line.
    """
    before = tomllib.loads(old)
    wanted = before | {
        table: before.get(table, {}) | dict(values) for table, values in changes.items()
    }
    text = old
    for table, values in changes.items():
        text = _with_table(text, table, values)
    try:
        is_so = tomllib.loads(text) == wanted
    except tomllib.TOMLDecodeError:
        is_so = False
    if not is_so:
        lines = "; ".join(
            f"{k} = {number_text(v)}" for t in changes.values() for k, v in t.items()
        )
        raise SettingsError(
            "is written so that its keys cannot be set one by one",
            where=path,
            remedy=f"set them by hand: {lines}",
        )
    return text


def _with_table(text: str, table: str, values: Mapping[str, float]) -> str:
    lines = text.rstrip("\n").split("\n") if text.strip() else []
    head = re.compile(rf"\s*\[\s*{re.escape(table)}\s*\]\s*(#.*)?$")
    start = next((i for i, line in enumerate(lines) if head.match(line)), None)
    if start is None:
        gap = [""] if lines and lines[-1].strip() else []
        new = [f"{key} = {number_text(value)}" for key, value in values.items()]
        return "\n".join([*lines, *gap, f"[{table}]", *new]) + "\n"
    later = (i for i in range(start + 1, len(lines)) if _HEAD.match(lines[i]))
    end = next(later, len(lines))
    added = []
    for key, value in values.items():
        said = f"{key} = {number_text(value)}"
        place = _line_of(key, lines, start, end)
        if place is None:
            added.append(said)
        else:
            lines[place] = said + _comment(lines[place])
    lines[start + 1 : start + 1] = added
    return "\n".join(lines) + "\n"


def _line_of(key: str, lines: list[str], start: int, end: int) -> int | None:
    own = re.compile(rf"""\s*["']?{re.escape(key)}["']?\s*=""")
    return next((i for i in range(start + 1, end) if own.match(lines[i])), None)


def _comment(line: str) -> str:
    """Of a line whose value is a number, which holds no # itself."""
    _, mark, said = line.partition("#")
    return f"  #{said}" if mark else ""

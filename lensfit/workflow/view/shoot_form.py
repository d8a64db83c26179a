"""A shoot file as a form: its fields, and the error of each field.

Fields are those of the shoot's records. A value is set in the file itself, line by
line; a value that the file's own reader refuses is not taken, and the error is shown at
its field.
"""

import re
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from lensfit.atomic import write_text_atomic
from lensfit.errors import LensfitError, ShootError
from lensfit.workflow.shoot.crew_notation import plain_form
from lensfit.workflow.shoot.shoot_file import load_shoot, shoot_of
from lensfit.workflow.shoot.shoot_records import Camera, LensName, Shoot, Take, Target
from lensfit.workflow.shoot.toml_lines import (
    toml_value,
    with_keys,
    with_table,
    without_table,
)
from lensfit.workflow.view.lens_adjustments import label_of

_RECORDS = {"lens": LensName, "camera": Camera, "target": Target, "take": Take}
_LISTED = ("target", "take")
_NAMED_BY = {"lens": "name", "target": "name", "take": "image"}
_TEXT = {
    "name", "serial", "model", "mosaic", "kind", "polarity", "dictionary", "image",
    "target", "encoding",
}  # fmt: skip
"""Keys whose values are text, whatever is typed."""
_BY_HAND = "change the file itself; the form follows it"
_NEW_TARGET = """\
[[target]]
name = "chart-{}"
kind = "dot-grid"  # TODO
pitch_mm = 1.0  # TODO
"""


class MovedTableError(ShootError):
    """The file was changed elsewhere: another table stands where one was meant.

    Attributes
    ----------
    status : Of the answer, by which a page knows that it shows another file.
    """

    status = 409


class Place(NamedTuple):
    """A field of the form.

    Attributes
    ----------
    place : Of the table in its list, from 0; None of one that stands alone.
    key : None for the table as a whole.
    """

    table: str
    place: int | None
    key: str | None


def form_of(path: Path, images: Path | None) -> tuple[dict[str, Any], Shoot | None]:
    """Tables with their fields and values; what is wrong; what nobody confirmed. And
    the shoot that they state, if nothing is wrong.

    A file that cannot be read, or is no TOML, has no tables.
    """
    data, fault, shoot = None, None, None
    try:
        data = _parsed_toml(_text(path), path)
        shoot = load_shoot(path, images)
    except ShootError as error:
        fault = {"error": str(error), **place_of_error(error)._asdict()}
    form = {
        "tables": [] if data is None else list(_tables(data, path)),
        "fault": fault,
        "notes": [] if shoot is None else list(shoot.notes),
        "unconfirmed": [] if shoot is None else list(shoot.unconfirmed),
    }
    return form, shoot


def _tables(data: dict[str, Any], path: Path):
    """As they stand, and what their groups and defaults say beneath."""
    try:
        plain, _ = plain_form(data, path)
    except ShootError:
        plain = data
    for table, record in _RECORDS.items():
        own, joined = data.get(table, {}), plain.get(table, {})
        if table not in _LISTED:
            yield _table(table, None, record, own, {})
            continue
        for place, one in enumerate(own if isinstance(own, list) else []):
            beneath = joined[place] if place < len(joined) else {}
            yield _table(table, place, record, one, beneath)


def _table(
    table: str, place: int | None, record: type, own: Any, beneath: Any
) -> dict[str, Any]:
    schema = msgspec.json.schema(record)
    properties = schema["$defs"][record.__name__]["properties"]
    own = own if isinstance(own, dict) else {}
    beneath = beneath if isinstance(beneath, dict) else {}
    needed = schema["$defs"][record.__name__].get("required", [])
    fields = [
        {
            "key": key,
            "label": label_of(key),
            "value": "" if key not in own else _value_text(own[key]),
            "beneath": "" if beneath.get(key) is None else _value_text(beneath[key]),
            "choices": _choices(properties[key]),
            "needed": key in needed,
        }
        for key in properties
    ]
    # As crews write them, a length without "_mm", say.
    others = [key for key in own if key not in properties]
    fields += [
        {
            "key": key, "label": label_of(key), "value": _value_text(own[key]),
            "beneath": "", "choices": [], "needed": False,
        }
        for key in others
    ]  # fmt: skip
    named = _name_of(table, own)
    return {"table": table, "place": place, "named": named, "fields": fields}


def _choices(schema: dict[str, Any]) -> list[str]:
    options = schema.get("anyOf", [schema])
    return [c for one in options for c in one.get("enum", ()) if isinstance(c, str)]


def _value_text(value: Any) -> str:
    return value if isinstance(value, str) else toml_value(value)


def require_named(path: Path, where: Place, named: str | None) -> None:
    """Check that a chart or a photograph still stands where a form showed it.

    Parameters
    ----------
    named : The name of the chart or the image of the photograph; None for whichever.

    Raises
    ------
    MovedTableError : Another stands there, or none.
    ShootError : There is no such file, or it is no TOML.
    """
    if named is None or where.table not in _LISTED:
        return
    listed = _parsed_toml(_text(path), path).get(where.table)
    tables = listed if isinstance(listed, list) else []
    place = where.place or 0
    found = tables[place] if place < len(tables) else None
    if isinstance(found, dict) and _name_of(where.table, found) == named:
        return
    now = f'"{_name_of(where.table, found)}"' if isinstance(found, dict) else "none"
    raise MovedTableError(
        f'the file was changed elsewhere: [[{where.table}]] {place + 1} was "{named}" '
        f"and is {now}; nothing was written",
        where=path,
        remedy="the form shows the file as it is now: change it again",
    )


def _name_of(table: str, own: dict[str, Any]) -> str:
    """The image of a photograph, the name of what has one; else nothing."""
    return _value_text(own.get(_NAMED_BY.get(table, ""), ""))


def set_field(path: Path, images: Path | None, where: Place, typed: str) -> None:
    """Set a key in the file to what was typed; nothing typed takes it away.

    Raises
    ------
    ShootError : The file's reader refuses it, or the key cannot be set line by line.
    OutputError : The file cannot be written.
    """
    if where.table not in _RECORDS or where.key is None or not where.key.isidentifier():
        raise ShootError(f'there is no field "{where.table}.{where.key}"', where=path)
    value = _value(where.key, typed.strip())
    changed = with_keys(_text(path), where.table, {where.key: value}, where.place)
    _write(path, images, changed, where)


def add_target(path: Path, images: Path | None) -> None:
    """One more chart, of which all is to be said.

    Raises
    ------
    ShootError, OutputError : As `set_field`.
    """
    text = _text(path)
    count = len(_parsed_toml(text, path).get("target", []))
    changed = with_table(text, "target", _NEW_TARGET.format(count + 1))
    _write(path, images, changed, Place("target", count, None))


def add_take(path: Path, images: Path | None, lines: str) -> None:
    """One more photograph, as it was drafted.

    Raises
    ------
    ShootError, OutputError : As `set_field`.
    """
    _write(path, images, with_table(_text(path), "take", lines), None)


def remove_table(path: Path, images: Path | None, table: str, place: int) -> None:
    """Take a chart or a photograph out of the file; the photograph itself stays.

    Raises
    ------
    ShootError, OutputError : As `set_field`.
    """
    if table not in _LISTED:
        raise ShootError(f"[{table}] cannot be removed", where=path)
    changed = without_table(_text(path), table, place)
    _write(path, images, changed, Place(table, place, None))


def place_of_error(error: LensfitError) -> Place:
    """The field that a sentence of the shoot's reader is about."""
    said = f"{error.where}: {error.what}"
    listed = re.search(r"\[\[(target|take)\]\] (\d+)(?:, (\w+))?", said)
    if listed:
        table, place, key = listed[1], int(listed[2]) - 1, listed[3]
    else:
        alone = re.search(r"\b(lens|camera)(?:\.(\w+))?: ", error.what)
        if not alone:
            return Place("", None, None)
        table, place, key = alone[1], None, alone[2]
    known = _RECORDS[table].__struct_fields__
    if key is None:
        key = next((w for w in re.findall(r"\w+", error.what) if w in known), None)
    return Place(table, place, key)


def beside_field(error: LensfitError, path: Path) -> str:
    """A sentence as it stands beside its field, which need not be named again."""
    said = str(error).removeprefix(f"{path}: ")
    said = re.sub(r"^(\[\[\w+\]\] \d+( \(.*?\))?|lens|camera)(, |: |\.)", "", said)
    return said.removeprefix(f"{place_of_error(error).key}: ")


def _write(
    path: Path, images: Path | None, text: str | None, where: Place | None
) -> None:
    """Take a text if it has no fault of its own making.

    Raises
    ------
    ShootError : The fault lies at `where`, or anywhere and there was none before.
    """
    if text is None:
        raise ShootError(
            "is written so that this cannot be changed from here",
            where=path,
            remedy=_BY_HAND,
        )
    try:
        shoot_of(_parsed_toml(text, path), text, path, images)
    except ShootError as error:
        found = place_of_error(error)
        if found == where or _is_whole(path, images):
            raise
    write_text_atomic(path, text)


def _is_whole(path: Path, images: Path | None) -> bool:
    try:
        load_shoot(path, images)
    except ShootError:
        return False
    return True


def _value(key: str, typed: str) -> Any:
    """What was typed, as TOML has it; else as text, which crews write lengths as."""
    if not typed:
        return None
    if key in _TEXT:
        return typed
    try:
        return tomllib.loads(f"value = {typed}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return typed


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ShootError(f"cannot be read ({error})", where=path) from error


def _parsed_toml(text: str, path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ShootError(
            f"is not valid TOML: {error}", where=path, remedy=_BY_HAND
        ) from error


def loaded_shoot(path: Path, images: Path | None) -> Shoot | None:
    """The shoot, where there is one that does not contradict itself."""
    try:
        return load_shoot(path, images)
    except ShootError:
        return None

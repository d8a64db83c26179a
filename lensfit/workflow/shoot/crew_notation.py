"""Convert a shoot file as a crew writes it to the plain form that is read strictly.

A value holds for everything below its table, and the nearest table counts:

    a [[take]], its [[group]], `takes` of its [[target]], [defaults]

A length may be text with its unit, under the key of the plain form or under one without
"_mm"; focus may be named after `[focus_marks]`; a stop may be text as it is engraved
("f/4", "T2.8"); a T-stop is used as f-number where none is stated, with a note, since
it is larger by what the glass absorbs.

Any length says its unit, or its key does (`lensfit.io.camera.quantity`). A focal length
must be possible for the width of its sensor: the shortest fisheyes are a twentieth as
long as their sensor is wide, the longest telescopes a few hundred times as long. What
lies beyond is in metres, or a slip.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from lensfit._strict import did_you_mean, refuse_unknown_keys
from lensfit.errors import CameraError, ShootError
from lensfit.io.camera.quantity import stop, written_length_mm
from lensfit.workflow.shoot.shoot_records import (
    LARGEST_F_NUMBER,
    SMALLEST_F_NUMBER,
    ShootFile,
    Take,
)

SHORTEST_WIDTHS, LONGEST_WIDTHS = 1 / 20, 500.0
"""Focal lengths, in widths of the sensor."""


def length_mm(text: str, key: str, where: str) -> float:
    """Millimetres of a length that names its unit.

    Parameters
    ----------
    text : As written.
    key, where : Of the value, for the message.

    Raises
    ------
    ShootError : It is no length, names no unit, or has twelve inches after feet.
    """
    try:
        return written_length_mm(text, key)
    except CameraError as error:
        raise ShootError(error.what, where=where, remedy=error.remedy) from error


def check_focal_length(
    focal_length_mm: float, sensor_width_mm: float, where: str
) -> None:
    """Refuse a focal length that no lens on such a sensor has.

    Raises
    ------
    ShootError : It is far too short or far too long.
    """
    widths = focal_length_mm / sensor_width_mm
    if SHORTEST_WIDTHS <= widths <= LONGEST_WIDTHS:
        return
    much = "short" if widths < 1 else "long"
    raise ShootError(
        f"focal_length_mm = {focal_length_mm:g} is too {much} for a sensor of "
        f"sensor_width_mm = {sensor_width_mm:g}",
        where=where,
        remedy="both are in millimetres",
    )


Tables = dict[str, Any]
KEY_OF_STOP = {"F": "f_number", "T": "t_number"}
"""Of a stop with its letter, in whatever column it stands."""
_TAKE_LENGTHS = ("focal_length_mm", "focus_distance_mm", "target_distance_mm")
_TARGET_LENGTHS = ("pitch_mm", "hole_diameter_mm", "line_width_mm")
_CAMERA_LENGTHS = ("sensor_width_mm", "sensor_height_mm")
_SHARED = (*Take.__struct_fields__[1:], "focus_mark", "t_number")
"""Keys of a take that many may share."""
_TABLES = (*ShootFile.__struct_fields__, "defaults", "group", "focus_marks")
_TAKE_KEYS = ("image", *_SHARED, "group")


def plain_form(data: Tables, path: Path) -> tuple[Tables, tuple[str, ...]]:
    """The tables of the plain form, and a note for each thing that was taken for
    another.

    Parameters
    ----------
    data : As TOML has it; what is malformed in itself is left to the strict reader.

    Raises
    ------
    ShootError : A length, group or focus mark that is none.
    """
    data = dict(data)
    refuse_unknown_keys(data, _TABLES, error=ShootError, where=path)
    marks = _focus_marks(data.pop("focus_marks", {}), path)
    defaults = _table(data.pop("defaults", {}), "defaults", path)
    groups = _tables_by_name(data.pop("group", []), "group", path)
    targets = [
        _with_lengths(one, _TARGET_LENGTHS, f"[[target]] {k}", path)
        for k, one in enumerate(_listed_tables(data, "target"), 1)
    ]
    by_target = {}
    for number, one in enumerate(targets, 1):
        shared = _table(one.pop("takes", {}), f"[[target]] {number}, takes", path)
        by_target[str(one.get("name"))] = shared
    notes: dict[str, None] = {}
    takes = []
    for number, take in enumerate(_listed_tables(data, "take"), 1):
        place = f"[[take]] {number}"
        joined = _joined_take(take, groups, by_target, defaults, place, path)
        joined = _with_focus_mark(joined, marks, place, path)
        takes.append(_with_f_number(joined, notes, f"{path}: {place}"))
    data |= {k: v for k, v in (("target", targets), ("take", takes)) if v}
    if isinstance(data.get("camera"), Mapping):
        data["camera"] = _with_lengths(data["camera"], _CAMERA_LENGTHS, "camera", path)
    return data, tuple(notes)


def _joined_take(
    take: Tables,
    groups: Mapping[str, Tables],
    by_target: Mapping[str, Tables],
    defaults: Tables,
    place: str,
    path: Path,
) -> Tables:
    """A take with what its group, its target and the defaults say."""
    own = _with_lengths(take, _TAKE_LENGTHS, place, path)
    refuse_unknown_keys(own, _TAKE_KEYS, error=ShootError, where=f"{path}: {place}")
    name = own.pop("group", None)
    group: Tables = {}
    if name is not None:
        if not isinstance(name, str) or name not in groups:
            remedy = 'give it a table, [[group]] with name = "..."'
            if groups:
                remedy = did_you_mean(str(name), list(groups))
            raise ShootError(
                f'no group is named "{name}"', where=f"{path}: {place}", remedy=remedy
            )
        group = groups[name]
    target = own.get("target", group.get("target", defaults.get("target")))
    layers = [defaults, by_target.get(str(target), {}), group, own]
    joined: Tables = {}
    for layer in layers:
        if "focus_mark" in layer:
            joined.pop("focus_distance_mm", None)
        if "focus_distance_mm" in layer:
            joined.pop("focus_mark", None)
        if "t_number" in layer:
            joined.pop("f_number", None)
        if "f_number" in layer:
            joined.pop("t_number", None)
        joined |= layer
    return joined


def _with_focus_mark(
    take: Tables, marks: Mapping[str, float], place: str, path: Path
) -> Tables:
    """Focus by the name of its mark."""
    name = take.pop("focus_mark", None)
    if name is None:
        return take
    if "focus_distance_mm" in take:
        raise ShootError(
            "states both focus_mark and focus_distance_mm",
            where=f"{path}: {place}",
            remedy="keep one of them",
        )
    name = str(name)  # the keys of [focus_marks] are text
    if name not in marks:
        raise ShootError(
            f'no focus mark is named "{name}"',
            where=f"{path}: {place}",
            remedy=did_you_mean(name, list(marks))
            if marks
            else "list it under [focus_marks]",
        )
    return take | {"focus_distance_mm": marks[name]}


def _with_f_number(take: Tables, notes: dict[str, None], where: str) -> Tables:
    """A T-stop in place of the f-number, where there is none."""
    stated = [(k, take.pop(k)) for k in ("t_number", "f_number") if k in take]
    stops = dict(_stop(value, key, where) for key, value in stated)
    t_stop = stops.pop("t_number", None)
    if t_stop is None or stops:
        return take | stops
    notes[
        "T-stops are used as f-numbers: they are larger by what the glass absorbs, up "
        "to a tenth; state f_number where blur is to be measured"
    ] = None
    return take | {"f_number": t_stop}


def _stop(value: Any, key: str, where: str) -> tuple[str, float]:
    """The key of a stop's kind, whatever key it stands under, and its number."""
    kind, number = None, 0.0
    if isinstance(value, str):
        with suppress(CameraError):
            kind, number = stop(value, key)
    elif type(value) in (int, float):  # true is a number to Python
        number = float(value)
    if SMALLEST_F_NUMBER <= number <= LARGEST_F_NUMBER:
        return KEY_OF_STOP.get(kind or "", key), number
    raise ShootError(
        f"{key} = {value} is none that a lens has",
        where=where,
        remedy=f"write {key} = 2.8 or the like",
    )


def _focus_marks(table: Any, path: Path) -> dict[str, float]:
    """Distances by the name of their mark, mm from the sensor."""
    marks = {}
    for name, value in _table(table, "focus_marks", path).items():
        place = f"{path}: focus_marks"
        if isinstance(value, str):
            value = length_mm(value, name, place)
        if isinstance(value, bool) or not isinstance(value, int | float) or value <= 0:
            raise ShootError(
                f"{name} = {value} is no distance",
                where=place,
                remedy=f'write {name} = "1.5 m" or the number of millimetres',
            )
        marks[name] = float(value)
    return marks


def _with_lengths(table: Any, keys: tuple[str, ...], place: str, path: Path) -> Tables:
    """Lengths in millimetres under their plain keys."""
    plain = dict(table) if isinstance(table, Mapping) else {}
    where = f"{path}: {place}"
    for key in keys:
        short = key.removesuffix("_mm")
        if short in plain:
            value = plain.pop(short)
            if key in plain:
                raise ShootError(f"states both {short} and {key}", where=where)
            if not _is_text(value):
                raise ShootError(
                    f"{short} = {value!r} names no unit",
                    where=where,
                    remedy=f"write {_with_unit(short, value)} or {key} = ...",
                )
            plain[key] = value
        if key in plain:
            plain[key] = _lengths_mm(plain[key], key, where)
    return plain


def _with_unit(short: str, value: Any) -> str:
    """How the line should read: distances are in metres, what is on glass, chart or
    sensor in millimetres."""
    unit = "m" if short.endswith("_distance") else "mm"
    each = value if isinstance(value, list) else [value]
    quoted = ", ".join(f'"{one} {unit}"' for one in each)
    return f"{short} = [{quoted}]" if isinstance(value, list) else f"{short} = {quoted}"


def _is_text(value: Any) -> bool:
    listed = isinstance(value, list) and all(isinstance(one, str) for one in value)
    return isinstance(value, str) or listed


def _lengths_mm(value: Any, key: str, where: str) -> Any:
    if isinstance(value, str):
        return length_mm(value, key, where)
    if isinstance(value, list):
        return [_lengths_mm(one, key, where) for one in value]
    return value


def _listed_tables(data: Tables, key: str) -> list[Tables]:
    """The tables of a list; what is none is left to the strict reader."""
    found = data.get(key, [])
    if not isinstance(found, list) or not all(isinstance(t, Mapping) for t in found):
        return []
    return [dict(one) for one in found]


def _table(
    table: Any, place: str, path: Path, known: Sequence[str] = _SHARED
) -> Tables:
    """A table of take keys in plain form, or of marks."""
    if not isinstance(table, Mapping):
        raise ShootError("should be a table", where=f"{path}: {place}")
    if place == "focus_marks":
        return dict(table)
    plain = _with_lengths(table, _TAKE_LENGTHS, place, path)
    if "image" in plain:
        raise ShootError("image belongs to one take", where=f"{path}: {place}")
    refuse_unknown_keys(plain, known, error=ShootError, where=f"{path}: {place}")
    return plain


def _tables_by_name(groups: Any, key: str, path: Path) -> dict[str, Tables]:
    named: dict[str, Tables] = {}
    if not isinstance(groups, list):
        raise ShootError(
            f"[{key}] is one table",
            where=path,
            remedy=f"write [[{key}]], with two brackets, once for each",
        )
    for number, group in enumerate(groups, 1):
        place = f"[[{key}]] {number}"
        table = _table(group, place, path, (*_SHARED, "name"))
        name = table.pop("name", None)
        if not isinstance(name, str) or not name or name in named:
            raise ShootError(
                "needs a name of its own",
                where=f"{path}: {place}",
                remedy='write name = "..." and group = "..." in its takes',
            )
        named[name] = table
    return named

"""Strict reading of hand-written files: every error names its key and a remedy.

`msgspec` checks types, ranges and unknown keys of nested tables in one pass; this
module turns its error into lensfit's one sentence, with the path of the key, plain
words for the types and, for an unknown key, the known one most like it.
"""

import difflib
import json
import math
import re
import tomllib
import typing
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from lensfit.bounded import read_bounded, utf8_text
from lensfit.errors import LensfitError

Record = TypeVar("Record")

LARGEST_BYTES = 32 * 2**20
"""A preset of a long zoom has one or two MiB."""
LARGEST_TOML_BYTES = 2**20
_MOST_DOTS = 2000
"""In a line; the parser of TOML takes the square of the parts of a dotted key."""
_DEEPEST = 64
_LARGEST_INTEGER = 2**63 - 1
_LONGEST_WORD = 60
_PLAIN = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": "nothing (null)",
}


def convert_strictly(
    data: object,
    record_type: type[Record],
    *,
    error: type[LensfitError],
    where: str | Path,
    place: Callable[[str], str] = str,
    lax: bool = False,
) -> Record:
    """`data` as a `record_type`, or `error` that names the key at fault.

    Parameters
    ----------
    data : Plain tables, lists, text and numbers.
    record_type : A `msgspec.Struct`.
    error : Which `LensfitError` to raise.
    where : The file, for the message.
    place : Spells a path such as "take[2].f_number" for its reader.
    lax : Numbers may be text.
    """
    try:
        return msgspec.convert(data, record_type, strict=not lax)
    except msgspec.ValidationError as complaint:
        said = plain_complaint(str(complaint), record_type, place)
        raise error(said, where=where) from complaint


def plain_complaint(
    complaint: str, record_type: Any, place: Callable[[str], str] = str
) -> str:
    """What msgspec complains of in words of its reader, the key first.

    Parameters
    ----------
    place : As of `convert_strictly`.
    """
    what, path = _reason_and_path(complaint)
    key = f"{place(path)}: " if path else ""
    return f"{key}{_plain_words(what, record_type, path)}"


def read_json_object(
    path: Path,
    *,
    error: type[LensfitError],
    source: str,
    mend: str,
    largest_bytes: int = LARGEST_BYTES,
) -> dict[str, Any]:
    """The object that a JSON file holds; no key of it may stand twice.

    Parameters
    ----------
    path : The file.
    error : Raised when the file cannot be read or is no JSON, naming `path`; also when
        it is larger, deeper or holds larger integers than any file of lensfit does.
    source, mend : What to do about the one, and about the other.
    largest_bytes : Of the file; no more is read.
    """
    content = read_bounded(path, largest_bytes, error=error, remedy=source)
    try:
        found = json.loads(content, object_pairs_hook=_without_duplicates)
        check_extent(found)
    except (ValueError, RecursionError) as reason:
        raise error(f"is not valid JSON: {reason}", where=path, remedy=mend) from reason
    if not isinstance(found, dict):
        raise error("is JSON but no object", where=path, remedy=source)
    return found


def read_toml_tables(
    path: Path,
    *,
    error: type[LensfitError],
    source: str,
    mend: str,
    largest_bytes: int = LARGEST_TOML_BYTES,
) -> dict[str, Any]:
    """The tables that a TOML file holds.

    Parameters
    ----------
    path : The file.
    error : Raised when the file cannot be read or is no TOML, naming `path`; also when
        it is larger or deeper than any file of lensfit is.
    source, mend : What to do about the one, and about the other.
    largest_bytes : Of the file; no more is read.
    """
    content = read_bounded(path, largest_bytes, error=error, remedy=source)
    text = utf8_text(content, path, error=error, remedy=mend)
    try:
        if any(line.count(".") > _MOST_DOTS for line in text.split("\n")):
            raise ValueError(f"a line has more than {_MOST_DOTS} dots")
        found = tomllib.loads(text)
        check_extent(found)
    except (ValueError, RecursionError) as reason:
        said = " ".join(str(reason).split())[:200]
        raise error(f"is not valid TOML: {said}", where=path, remedy=mend) from reason
    return found


def check_extent(found: object) -> None:
    """Raise a ValueError for what no step after this one can take."""
    level = [found]
    for _ in range(_DEEPEST):
        inner: list[object] = []
        for value in level:
            if isinstance(value, dict):
                inner += value.keys()
                inner += value.values()
            elif isinstance(value, list):
                inner += value
            elif isinstance(value, int) and abs(value) > _LARGEST_INTEGER:
                raise ValueError("an integer of more than 64 bits")
            elif isinstance(value, str) and not value.isascii():
                value.encode()  # half a surrogate pair is no text
        level = inner
        if not level:
            return
    raise ValueError(f"nested deeper than {_DEEPEST}")


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    tables = dict(pairs)
    if len(tables) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f'key "{_short_word(twice)}" stands twice in one object')
    return tables


def non_finite_numbers(data: object, path: str = "") -> Iterator[tuple[str, float]]:
    """Path and value of every NaN and infinity in plain tables and lists."""
    if isinstance(data, dict):
        for key, value in data.items():
            word = _short_word(str(key))
            yield from non_finite_numbers(value, f"{path}.{word}" if path else word)
    elif isinstance(data, (list, tuple)):
        for index, value in enumerate(data):
            yield from non_finite_numbers(value, f"{path}[{index}]")
    elif isinstance(data, float) and not math.isfinite(data):
        yield path, data


def array_table_place(key: str) -> str:
    """ "take[2].f_number" as its reader finds it: "[[take]] 3, f_number"."""
    table, bracket, rest = key.partition("[")
    index, _, inner = rest.partition("]")
    if not bracket or "." in table or not index.isdigit():
        return key
    name = inner.lstrip(".")
    return f"[[{table}]] {int(index) + 1}" + (f", {name}" if name else "")


def did_you_mean(word: str, known: list[str]) -> str:
    """'did you mean "dots"?', or what the choices are when nothing looks like it."""
    by_lower_case = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), by_lower_case, n=1, cutoff=0.6)
    if close:
        return f'did you mean "{by_lower_case[close[0]]}"?'
    return "known here: " + ", ".join(known) if known else "none is known here"


def refuse_unknown_keys(
    table: Iterable[str],
    known: Sequence[str],
    *,
    error: type[LensfitError],
    where: str | Path,
) -> None:
    """Raise on the first key that is not known, in the words of `convert_strictly`."""
    for key in table:
        if key not in known:
            raise error(_unknown_key(key, list(known)), where=where)


def _unknown_key(key: str, known: list[str]) -> str:
    return f'unknown key "{_short_word(key)}"; {did_you_mean(key, known)}'


def _reason_and_path(complaint: str) -> tuple[str, str]:
    """What is wrong, and the path of the key without its leading "$."."""
    match = re.fullmatch(r"(?s)(.*) - at `\$\.?(.*)`", complaint)
    return (match[1], match[2]) if match else (complaint, "")


def _plain_words(what: str, record_type: Any, path: str) -> str:
    unknown = re.fullmatch(r"(?s)Object contains unknown field `(.*)`", what)
    if unknown:
        return _unknown_key(unknown[1], _keys_at(record_type, path))
    missing = re.fullmatch(r"Object missing required field `(.*)`", what)
    if missing:
        return f'key "{missing[1]}" is missing; add it'
    choice = re.fullmatch(r"(?s)Invalid enum value '?(.*?)'?", what)
    if choice:
        known = [str(literal) for literal in _literals(_type_at(record_type, path))]
        hint = did_you_mean(choice[1], known)
        return f'"{_short_word(choice[1])}" is unknown; {hint}'
    what = re.sub(r"`([a-z| ]+)`", lambda types: _plain_types(types[1]), what)
    what = re.sub(r"(length )?([<>]=?) (-?[\d.e+-]+)", _plain_bound, what)
    return what[:1].lower() + what[1:]


_BOUNDS = {">": "above", ">=": "of at least", "<": "below", "<=": "of at most"}


def _plain_bound(found: re.Match[str]) -> str:
    words = f"{_BOUNDS[found[2]]} {float(found[3]):g}"
    return found[1] + words.removeprefix("of ") if found[1] else words


def _short_word(word: str) -> str:
    return word if len(word) <= _LONGEST_WORD else f"{word[:_LONGEST_WORD]}..."


def _plain_types(types: str) -> str:
    names = types.split(" | ")
    if len(names) > 1:  # a key that may be null may be left out; no need to say so
        names = [name for name in names if name != "null"]
    return " or ".join(_PLAIN.get(name, name) for name in names)


def _type_at(record_type: Any, path: str) -> Any:
    """The annotation that the key at `path` has."""
    for step in re.findall(r"[^.\[\]]+|\[", path):
        if step.isdigit() or step == "...":
            continue
        if step == "[":
            record_type = (_arguments(record_type) or [Any])[0]
            continue
        fields = {f.encode_name: f.type for f in _fields(record_type)}
        record_type = fields.get(step, Any)
    return record_type


def _keys_at(record_type: Any, path: str) -> list[str]:
    return [field.encode_name for field in _fields(_type_at(record_type, path))]


def _fields(annotation: Any) -> list[Any]:
    """Fields of the first Struct in an annotation such as `Struct | None`."""
    for candidate in (annotation, *typing.get_args(annotation)):
        if isinstance(candidate, type) and issubclass(candidate, msgspec.Struct):
            return list(msgspec.structs.fields(candidate))
    return []


def _arguments(annotation: Any) -> list[Any]:
    """Element types of a container, also of `container | None`."""
    for candidate in (annotation, *typing.get_args(annotation)):
        if typing.get_origin(candidate) in (list, tuple, dict):
            return [a for a in typing.get_args(candidate) if a is not Ellipsis]
    return []


def _literals(annotation: Any) -> list[Any]:
    if typing.get_origin(annotation) is typing.Literal:
        return list(typing.get_args(annotation))
    found = [_literals(inner) for inner in typing.get_args(annotation)]
    return [value for values in found for value in values]

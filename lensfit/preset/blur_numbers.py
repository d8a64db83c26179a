"""The numbers of a blur block by name, so that any of them can be changed.

A name is the path to the number in the file. In lists whose order means nothing, a
member is named by its identity: a term of the aberration function by part, degree,
order, field degree and field order, a stop by its f-number:

    focus_offset_mm
    pupil.rims[0].shift[1]
    aberrations[re 3 1 1 1].um
    stops[f/2.8].radius_ratio
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import msgspec

from lensfit.preset.blur_blocks import Blur

_TERM = ("part", "degree", "order", "field_degree", "field_order")


def numbers_of(blur: Blur) -> dict[str, float]:
    """Every number of a block that is no count, by its name."""
    return dict(_numbers(_tables(blur), ""))


def with_moves(blur: Blur, moves: Mapping[str, float]) -> Blur:
    """The block with some numbers moved; a name that it lacks moves nothing.

    Raises
    ------
    ValueError : A number leaves the range it may have.
    """
    moved = _mapped(_tables(blur), "", lambda name, v: v + float(moves.get(name, 0.0)))
    try:
        found = msgspec.convert(moved, Blur)
    except msgspec.ValidationError as error:
        raise ValueError(f"no blur can be so: {error}") from error
    return msgspec.structs.replace(found, uncertainty=blur.uncertainty)


def _tables(blur: Blur) -> dict[str, Any]:
    return msgspec.to_builtins(msgspec.structs.replace(blur, uncertainty=None))


def _numbers(value: Any, name: str) -> Iterator[tuple[str, float]]:
    for inner, item in _inside(value, name):
        if isinstance(item, float) and math.isfinite(item):
            yield inner, item
        else:
            yield from _numbers(item, inner)


def _mapped(value: Any, name: str, change: Callable[[str, float], float]) -> Any:
    if isinstance(value, float):
        return change(name, value)
    items = [_mapped(item, inner, change) for inner, item in _inside(value, name)]
    if isinstance(value, dict):
        return dict(zip(value, items, strict=True))
    return items if isinstance(value, (list, tuple)) else value


def _inside(value: Any, name: str) -> list[tuple[str, Any]]:
    """Name and value of everything in a table or a list; nothing in anything else."""
    if isinstance(value, dict):
        dot = "." if name else ""
        return [(f"{name}{dot}{key}", item) for key, item in value.items()]
    if isinstance(value, (list, tuple)):
        return [(f"{name}[{_key(k, item)}]", item) for k, item in enumerate(value)]
    return []


def _key(index: int, item: Any) -> str:
    if isinstance(item, dict) and "field_degree" in item:
        return " ".join(str(item[key]) for key in _TERM)
    if isinstance(item, dict) and "f_number" in item:
        return f"f/{item['f_number']:g}"
    return str(index)

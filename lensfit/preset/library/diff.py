"""Two presets compared key by key, measured numbers against their deviation.

Members of lists are matched by what they are (an entry by focal length and focus, a
fall-off by its f-number), not by where they stand. Records of the measurement (terms,
covariance, provenance) are left out: they differ between any two calibrations.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from lensfit.preset.library.deviations import Deviations, deviations_of
from lensfit.preset.library.key_path import (
    IDENTITY,
    MISSING,
    complete_tables,
    member_text,
)
from lensfit.preset.schema import Preset

_RECORDS = ("schema", "conventions", "provenance", "saved", "terms", "covariance")


class Difference(NamedTuple):
    """A key at which two presets differ.

    Attributes
    ----------
    a, b : The values; `MISSING` where one has none.
    relative : (b - a) / |a| of two numbers; None otherwise, and where a is 0.
    deviations : (b - a) in standard deviations of the difference, as far as the presets
        state one of both or of either; None otherwise.
    """

    key: str
    a: Any
    b: Any
    relative: float | None
    deviations: float | None


def differences(a: Preset, b: Preset) -> list[Difference]:
    """Every key at which two presets differ, in the order of the schema."""
    spread = deviations_of(a), deviations_of(b)
    return [
        _difference(key, old, new, spread)
        for key, old, new in _compared(complete_tables(a), complete_tables(b), "")
    ]


def _difference(
    key: str, a: Any, b: Any, spread: tuple[Deviations, Deviations]
) -> Difference:
    if not (_is_number(a) and _is_number(b)):
        return Difference(key, a, b, None, None)
    known = [of[key] for of in spread if of.get(key, 0.0) > 0]
    total = math.hypot(*known)
    return Difference(
        key,
        a,
        b,
        (b - a) / abs(a) if a else None,
        (b - a) / total if known else None,
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def _compared(a: Any, b: Any, key: str) -> Iterator[tuple[str, Any, Any]]:
    """Key and both values of what differs below a key."""
    if isinstance(a, dict) and isinstance(b, dict):
        for name in [*a, *(n for n in b if n not in a)]:
            if name not in _RECORDS:
                below = f"{key}.{name}" if key else name
                yield from _compared(a.get(name, MISSING), b.get(name, MISSING), below)
    elif isinstance(a, list) and isinstance(b, list):
        name = key.rpartition(".")[2]
        old, new = _members(a, name), _members(b, name)
        for member in [*old, *(m for m in new if m not in old)]:
            yield from _compared(
                old.get(member, MISSING), new.get(member, MISSING), key + member
            )
    elif a is not b and (a != b or type(a) is not type(b)):
        yield key, a, b


def _members(values: list[Any], name: str) -> dict[str, Any]:
    """Members of a list by how a key names them."""
    if name in IDENTITY and all(isinstance(v, dict) for v in values):
        return {member_text(name, v, i): v for i, v in enumerate(values)}
    return {f"[{i}]": v for i, v in enumerate(values)}

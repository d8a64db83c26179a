"""Rows of a benchmark: a figure, the bar it is held to, and whether it passes."""

import math
from typing import Any

from msgspec import Struct, to_builtins

HONEST, SLACK = 68.0, 8.0
"""Percent of errors that one stated deviation covers, and how far off is passed."""


class Row(Struct, frozen=True):
    """One figure and its bar.

    Attributes
    ----------
    set : Of photographs.
    what : Is measured, with its unit.
    value : Measured now.
    bar : Largest value that passes (`least`: smallest); None informs only.
    aim : Where it should get to.
    peers : The same figure of other programs in the same run, by name.
    least : The bar is a lower one.
    expected : A value that `value` should be within `bar` of, in place of zero.
    """

    set: str
    what: str
    value: float
    bar: float | None = None
    aim: float | None = None
    peers: dict[str, float] = {}
    least: bool = False
    expected: float | None = None

    @property
    def passed(self) -> bool | None:
        """Whether the bar is met; None without a bar. An undefined value never is."""
        if self.bar is None:
            return None
        if math.isnan(self.value):
            return False
        if self.least:
            return self.value >= self.bar
        return abs(self.value - (self.expected or 0.0)) <= self.bar


def as_tables(rows: list[Row]) -> list[dict[str, Any]]:
    """Rows for JSON, undefined numbers as null."""
    return [_without_nan(to_builtins(row)) | {"passed": row.passed} for row in rows]


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_nan(v) for k, v in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value

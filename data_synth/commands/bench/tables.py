"""Results of benchmarks as tables: a row for each bar, or for each set."""

import math
from typing import Any

from rich.table import Table

_VERDICTS = {True: "pass", False: "[bold]falls short[/bold]", None: ""}


def bars_table(rows: list[dict[str, Any]]) -> Table:
    """One row for each bar: value, bar, aim, what peers make of it, verdict."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("set")
    table.add_column("what")
    for name in ("value", "bar", "aim"):
        table.add_column(name, justify="right")
    table.add_column("in the same run")
    table.add_column("verdict")
    for row in rows:
        peers = ", ".join(f"{k} {_figure(v)}" for k, v in row["peers"].items())
        sign = "≥ " if row["least"] else "± " if row["expected"] else "≤ "
        bar = _figure(row["bar"]) if row["bar"] is None else sign + _figure(row["bar"])
        verdict = _VERDICTS[row["passed"]]
        figures = (_figure(row["value"]), bar, _figure(row["aim"]))
        table.add_row(row["set"], row["what"], *figures, peers, verdict)
    return table


def counts_table(sets: list[dict[str, Any]]) -> Table:
    """One row for each set of photographs: marks, residuals, seconds."""
    columns = {
        "photographs": "photographs",
        "candidates": "candidates",
        "indexed": "indexed",
        "used": "used",
        "rms_px": "rms px",
        "detect_s": "detect s",
        "first_fit_s": "first fit s",
        "fit_s": "fit s",
    }
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("set")
    for name in columns.values():
        table.add_column(name, justify="right")
    for one in sets:
        table.add_row(one["set"], *(_figure(one[key]) for key in columns))
    return table


def _figure(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "–"
    if value == round(value) and abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.3g}"

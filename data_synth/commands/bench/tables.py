"""Results of benchmarks as tables: bars, sets, curves, and where the time goes."""

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
    """One row for each set of photographs: detections, residuals, seconds."""
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


_TITLES = {
    "plate": "error against time, path-traced plate",
    "uhd": "error against time, synthetic frame of 3840 x 2160",
    "pixels": "time against pixels",
    "blur": "time against the area of the blur",
    "warp": "warp, four channels",
}
_NAMES = {
    "tolerance": "tolerance",
    "expected": "expected rms",
    "rms": "rms error",
    "psnr_db": "PSNR, dB",
    "seconds": "s",
    "cpu_seconds": "processor s",
    "seconds_per_megapixel": "s per megapixel",
    "megapixels": "megapixels",
    "blur_area_px": "blur, px",
    "size": "frame",
    "method": "method",
    "first_s": "first, s",
    "spread_s": "spread, s",
}


def curve_tables(curves: dict[str, list[dict[str, Any]]]) -> list[Table]:
    """One for each curve."""
    return [_curve_table(_TITLES[name], points) for name, points in curves.items()]


def _curve_table(title: str, points: list[dict[str, Any]]) -> Table:
    table = Table(
        box=None,
        pad_edge=False,
        header_style="bold",
        title=title,
        title_justify="left",
    )
    keys = list(points[0])
    for key in keys:
        table.add_column(_NAMES[key], justify="right")
    for point in points:
        table.add_row(*(_shown(point[key]) for key in keys))
    return table


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.3g}"


_LEAST_SHARE = 0.02
_STAGES = 8


def profile_tables(result: dict[str, Any]) -> list[Table]:
    """One for each profile, and one for all floors; none where nothing was profiled."""
    tables = [_profile(*item) for item in result.get("profiles", {}).items()]
    floors = result.get("floors", [])
    return tables + ([_floors(floors)] if floors else [])


def _profile(name: str, seconds: dict[str, float]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column(f"time of {name}, by stage", no_wrap=True)
    table.add_column("s", justify="right")
    table.add_column("share", justify="right")
    whole = sum(seconds.values()) or 1.0
    shown = {k: v for k, v in seconds.items() if v >= _LEAST_SHARE * whole}
    for stage, spent in list(shown.items())[:_STAGES]:
        table.add_row(stage, f"{spent:.3g}", f"{100 * spent / whole:.0f} %")
    table.add_row("all", f"{whole:.3g}", "")
    return table


def _floors(floors: list[dict[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("set")
    table.add_column("distance from the floor")
    for heading in ("needs", "this machine", "floor, ms", "measured, ms", "times"):
        table.add_column(heading, justify="right")
    for one in floors:
        table.add_row(
            one["set"],
            one["stage"],
            f"{one['needs']:.3g} {one['unit']}",
            f"{one['rate']:.3g} {one['unit']}/s",
            f"{1000 * one['floor_s']:.3g}",
            f"{1000 * one['seconds']:.3g}",
            f"{one['distance']:.2g}",
        )
    return table

"""Where the time goes, and how far it is from the floor, as tables."""

from typing import Any

from rich.table import Table

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

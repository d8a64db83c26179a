"""What a calibration found, as a table on standard output."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from lensfit.printable import printable
from lensfit.report.markup import number
from lensfit.report.verdict import verdict_of, verdict_scope

Report = dict[str, Any]


def print_summary(report: Report) -> None:
    """Verdict, one row for each take, and the whole."""
    console = Console(highlight=False, soft_wrap=True)
    judged = verdict_of(report)
    first, *rest = judged.reasons
    for text in (first.text, verdict_scope(judged), *(one.text for one in rest)):
        console.print(printable(text), markup=False)
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("take")
    for name in ("points", "used", "rms px", "held-out rms px"):
        table.add_column(name, justify="right")
    takes = report.get("takes") or []
    for take in takes:
        if not take.get("failed"):
            name = str(take.get("name") or take.get("image"))
            table.add_row(Text(printable(name)), *_figures(take))
    if len(takes) != 1:
        table.add_row("all", *_figures(report), style="bold")
    console.print()
    console.print(table)


def failed_takes(report: Report) -> list[str]:
    """One line for each take that could not be used."""
    takes = report.get("takes") or []
    return [str(take["failed"]) for take in takes if take.get("failed")]


def print_files(out_dir: Path, files: dict[str, Any]) -> None:
    """Where each result lies."""
    console = Console(highlight=False, soft_wrap=True)
    console.print()
    for kind, names in files.items():
        for name in [names] if isinstance(names, str) else names or []:
            line = f"{kind:<10} {out_dir / name}"
            console.print(printable(line), markup=False)


def _figures(errors: dict[str, Any]) -> list[str]:
    keys = ("points_detected", "points_used", "rms_px", "held_out_rms_px")
    return [number(errors.get(key)) for key in keys]

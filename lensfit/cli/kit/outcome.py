"""How a kit's results are said, and that a lens failed."""

import json
from collections.abc import Container
from pathlib import Path
from typing import Any

import typer

from lensfit.cli._console import say_line
from lensfit.cli._door import say_error
from lensfit.preset.verdict import is_at_least


def show_kit(
    table: dict[str, Any],
    out: Path,
    as_json: bool,
    require: str | None,
    only: Container[str] | None = None,
) -> None:
    """A line for each lens, then the files; the exit code is 1 when a lens failed, or
    is not calibrated though it was asked for, or is below the level required.

    Parameters
    ----------
    only : Folders of the lenses that were asked for; None for all.
    """
    from lensfit.report.markup import number
    from lensfit.workflow.kit.kit_page import summary

    lenses = table["lenses"]
    if as_json:
        typer.echo(json.dumps(table))
    else:
        say_line(summary(lenses))
        for lens in lenses:
            judged = lens.get("verdict") or {}
            level = judged.get("level") or lens["state"]
            accuracy = number(judged.get("accuracy_px"), "px", 2)
            say_line(f"{lens['folder']:<28} {level:<14} {accuracy}")
        for name in ("kit.html", "kit.json"):
            say_line(str(out / name))
    bad = False
    for lens in lenses:
        if only is not None and lens["folder"] not in only:
            continue
        why = _why_not(lens, require)
        if why is not None:
            say_error(f"{lens['folder']}: {why}")
            bad = True
    if bad:
        raise typer.Exit(1)


def _why_not(lens: dict[str, Any], require: str | None) -> str | None:
    if lens["failed"]:
        return str(lens["failed"])
    judged = lens.get("verdict")
    if require is None:
        return None
    if judged is None:
        return "not calibrated yet"
    if is_at_least(judged["level"], require):  # pyright: ignore[reportArgumentType]
        return None
    return f"the verdict is {judged['level']}, below {require}: {judged['headline']}"

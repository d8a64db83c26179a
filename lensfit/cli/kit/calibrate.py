"""`lensfit kit calibrate`: every lens of a kit, as many at once as there are cores."""

from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._bars import progress_bars
from lensfit.cli._efforts import EffortOption
from lensfit.cli.kit.options import AsJson, KitPath, Lenses, RequireOfAll
from lensfit.cli.kit.outcome import show_kit


def calibrate(
    kit: KitPath,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results")],
    lens: Lenses = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Lenses at once; one per core by default")
    ] = None,
    effort: EffortOption = "normal",
    again: Annotated[
        bool, typer.Option("--again", help="Calibrate those too that are done")
    ] = False,
    require: RequireOfAll = None,
    as_json: AsJson = False,
) -> None:
    """Measure every lens of a kit; run again, it goes on where it was stopped.

    Each lens gets a folder as calibrate writes it; kit.html and kit.json beside them
    hold all lenses. A lens that fails does not stop the others: it is named in a line,
    and the exit code is 1.

    Example: lensfit kit calibrate kit.toml --out results
    """
    from lensfit.workflow.kit.calibrate import calibrate_kit, chosen_lenses
    from lensfit.workflow.kit.kit_file import load_kit

    described = load_kit(kit)
    with progress_bars() as progress:
        table = calibrate_kit(
            described,
            out,
            only=lens or [],
            effort=effort,
            workers=workers,
            again=again,
            progress=progress,
        )
    chosen = set(chosen_lenses(described, lens or []))
    show_kit(table, out, as_json, require, chosen)

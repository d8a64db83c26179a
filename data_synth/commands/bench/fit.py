"""`lensfit bench fit`: sets of photographs, detected and fitted, against bars."""

import json
from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.bench.options import AsJson, OnlySet, SetsFolder
from data_synth.commands.bench.outcome import fail_if_any, print_profiles, say_machine
from lensfit.cli._terminal import console, progress_bars


def fit(
    data: SetsFolder,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for JSON and overlays")
    ] = None,
    as_json: AsJson = False,
    only: OnlySet = None,
) -> None:
    """Detect and fit sets of photographs; one row per bar, pass or fall short.

    Falling short is no error; a photograph that cannot be used is, and the exit code
    is then 1.

    Example: lensfit bench fit --data data --only dot_pattern_05
    """
    from data_synth.bench.fit.benchmark import bench_fit

    with progress_bars() as progress:
        result = bench_fit(data, out, only=only, progress=progress)
    if as_json:
        typer.echo(json.dumps(result))
    else:
        from data_synth.commands.bench.tables import bars_table, counts_table

        say_machine(result)
        screen = console()
        screen.print(bars_table(result["rows"]))
        screen.print()
        screen.print(counts_table(result["sets"]))
        print_profiles(result)
    fail_if_any(result["errors"])

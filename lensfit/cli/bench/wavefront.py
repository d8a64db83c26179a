"""`lensfit bench wavefront`: lenses of an exact ray tracer, judged by their truth."""

import json
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._bars import progress_bars
from lensfit.cli._console import console
from lensfit.cli.bench.options import AsJson
from lensfit.cli.bench.outcome import fail_if_any, say_machine


def wavefront(
    lenses: Annotated[
        int, typer.Option("--lenses", min=0, help="How many random lenses")
    ] = 3,
    cases: Annotated[
        list[str] | None,
        typer.Option("--cases", help="A hard case by name, or all; may be repeated"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for shoots, presets and JSON")
    ] = None,
    size: Annotated[str, typer.Option("--size", help="WIDTHxHEIGHT, px")] = "1024x768",
    seed: Annotated[int, typer.Option("--seed", help="Of lenses and noise")] = 0,
    reuse: Annotated[
        bool, typer.Option("--reuse", help="Keep photographs that lie in --out")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate lenses that an exact ray tracer photographed; judge each by its truth.

    Random lenses are published designs of 14 to 135 mm and f/1.2 to f/8 with the errors
    of a workshop. One row for each lens; the exit code is 1 when one of them failed.

    Example: lensfit bench wavefront --lenses 2 --cases fast --cases jpeg --out bench
    """
    from lensfit.cli.bench.trials import judged, trials_of, wavefront_table
    from lensfit.workflow.bench_wavefront import bench_wavefront

    trials = trials_of(lenses, cases or [], size, seed)
    with progress_bars() as progress:
        result = bench_wavefront(trials, judged, out, reuse=reuse, progress=progress)
    if as_json:
        typer.echo(json.dumps(result))
    else:
        say_machine(result)
        console().print(wavefront_table(result["rows"]))
    fail_if_any(result["errors"])

"""`lensfit bench coverage`: whether stated uncertainties are true."""

import json
from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.bench.options import AsJson
from data_synth.commands.bench.outcome import fail_if_any, say_machine
from lensfit.cli._door import one_of
from lensfit.cli._options import EFFORT_HELP, EFFORTS
from lensfit.cli._terminal import console, progress_bars


def coverage(
    out: Annotated[
        Path, typer.Option("--out", help="Folder for shoot, draws and JSON")
    ],
    draws: Annotated[
        int, typer.Option("--draws", min=2, help="How many exposures to calibrate")
    ] = 100,
    lens: Annotated[
        str, typer.Option("--lens", help="A bundled lens, or a prescription file")
    ] = "biotar_50",
    size: Annotated[str, typer.Option("--size", help="WIDTHxHEIGHT, px")] = "480x360",
    effort: Annotated[
        str,
        typer.Option(
            help="Of the fit of blur: " + EFFORT_HELP, callback=one_of(EFFORTS)
        ),
    ] = "fastest",
    as_json: AsJson = False,
) -> None:
    """Photograph a traced lens once, expose it often, and compare each calibration's
    stated deviations with its errors.

    A stated deviation should cover 60 to 76 % of the errors against the truth. Draws
    that lie in --out are kept, so that a stopped run goes on.

    Example: lensfit bench coverage --draws 100 --out coverage
    """
    from data_synth.bench.coverage.benchmark import bench_coverage
    from data_synth.commands.bench.exposures import subject_of
    from data_synth.commands.bench.tables import bars_table

    subject = subject_of(lens, size)
    with progress_bars() as progress:
        result = bench_coverage(
            subject, out, draws=draws, effort=effort, progress=progress
        )
    if as_json:
        typer.echo(json.dumps(result))
    else:
        say_machine(result)
        console().print(bars_table(result["rows"]))
        typer.echo(f"{result['draws']} draws, {result['processor_s']} processor s each")
    fail_if_any(result["errors"])

"""`lensfit bench blur`: pixels of real dots, predicted by the blur of others."""

import json
from typing import Annotated

import typer

from data_synth.commands.bench.options import AsJson, JsonFolder, OnlySet, SetsFolder
from data_synth.commands.bench.outcome import fail_if_any, say_machine
from lensfit.cli._bars import progress_bars
from lensfit.cli._console import console
from lensfit.cli._door import one_of
from lensfit.cli._efforts import EFFORT_HELP, EFFORTS


def blur(
    data: SetsFolder,
    out: JsonFolder = None,
    as_json: AsJson = False,
    only: OnlySet = None,
    effort: Annotated[
        str, typer.Option(help=EFFORT_HELP, callback=one_of(EFFORTS))
    ] = "normal",
) -> None:
    """Fit the blur of real photographs, and predict dots that the fit did not see.

    Beside Gaussians that were fitted to other dots, and the noise of the pixels.
    Falling short is no error; a set without blur is, and the exit code is then 1.

    Example: lensfit bench blur --data data --only dot_pattern_05
    """
    from data_synth.bench.blur import bench_blur
    from lensfit.fitting.wavefront.effort import Effort

    with progress_bars() as progress:
        result = bench_blur(
            data, out, only=only, effort=Effort.from_name(effort), progress=progress
        )
    if as_json:
        typer.echo(json.dumps(result))
    else:
        from data_synth.commands.bench.tables import bars_table

        say_machine(result)
        console().print(bars_table(result["rows"]))
    fail_if_any(result["errors"])

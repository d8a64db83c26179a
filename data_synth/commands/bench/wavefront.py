"""`lensfit bench wavefront`: lenses of an exact ray tracer, judged by their truth."""

import json
from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.bench.beside import BesideGroup
from data_synth.commands.bench.options import AsJson
from data_synth.commands.bench.outcome import fail_if_any, say_machine
from lensfit.cli._terminal import console, progress_bars
from lensfit.cli.groups import takes_groups


@takes_groups
def wavefront(
    beside: BesideGroup,
    lenses: Annotated[
        int, typer.Option("--lenses", min=0, help="How many random lenses")
    ] = 3,
    cases: Annotated[
        list[str] | None,
        typer.Option(
            "--cases", help="A hard case or bundled lens, or all; may be repeated"
        ),
    ] = None,
    data: Annotated[
        Path | None, typer.Option("--data", help="Folder with oracle/dg50, tried too")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for shoots, presets, JSON and plots"),
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
    Peers, takes left out and efforts are fitted to the same photographs and get rows
    with bars.

    Example: lensfit bench wavefront --lenses 2 --cases fast --cases jpeg --out bench

    Example: lensfit bench wavefront --lenses 0 --cases nikkor_28 --peers --effort fast
    """
    from data_synth.bench.wavefront.benchmark import bench_wavefront
    from data_synth.commands.bench.tables import bars_table
    from data_synth.commands.bench.trials import judged, trials_of, wavefront_table

    trials = trials_of(lenses, cases or [], size, seed, data)
    wanted = beside.wanted()
    with progress_bars() as progress:
        result = bench_wavefront(
            trials, judged, out, reuse=reuse, beside=wanted, progress=progress
        )
    if as_json:
        typer.echo(json.dumps(result))
    else:
        say_machine(result)
        console().print(wavefront_table(result["rows"]))
        if wanted.is_wanted:
            console().print(bars_table(result["bars"]))
    fail_if_any(result["errors"])

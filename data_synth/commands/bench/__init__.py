"""`lensfit bench`: measured now, on this machine, next to what others make of it.

`all` runs every benchmark, for one table.
"""

from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.bench.coverage import coverage
from data_synth.commands.bench.exchange import exchange
from data_synth.commands.bench.outcome import AsJson, show
from data_synth.commands.bench.photographs import blur, detect, fit
from data_synth.commands.bench.rendering import render, warp
from data_synth.commands.bench.verdict import verdict
from data_synth.commands.bench.wavefront import wavefront
from lensfit.cli._terminal import progress_bars


def every(
    data: Annotated[
        Path | None,
        typer.Option("--data", help="Folder with real/, oracle/ and plates/"),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for JSON, plots and shoots")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Small sets and frames, in minutes")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run every benchmark; one table with a row for each bar.

    Example: lensfit bench all --quick --data data
    """
    from data_synth.bench.every import bench_all
    from data_synth.commands.bench.wavefront import judged, trials_of

    trials = (
        trials_of(0, ["tiny_dots"], "640x480", 0)
        if quick
        else trials_of(3, ["all"], "1024x768", 0, _oracle_in(data))
    )
    with progress_bars() as progress:
        result = bench_all(trials, judged, data, out, quick=quick, progress=progress)
    show(result, as_json)


def _oracle_in(data: Path | None) -> Path | None:
    """The folder, where it has a lens traced elsewhere."""
    from data_synth.commands.bench.wavefront import ORACLE

    has_it = data is not None and (data / "oracle" / ORACLE / "shoot.toml").is_file()
    return data if has_it else None


app = typer.Typer(no_args_is_help=True, help="Measure lensfit against bars and peers.")
for command in (
    detect,
    fit,
    wavefront,
    blur,
    coverage,
    render,
    warp,
    exchange,
    verdict,
):
    app.command()(command)
app.command("all")(every)

"""`lensfit bench all`: every benchmark, one table."""

from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.bench.outcome import AsJson, show
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

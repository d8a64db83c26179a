"""`lensfit bench warp`: one warp by lensfit and by what a user would pick instead."""

import json

import typer

from data_synth.commands.bench.options import AsJson, JsonFolder, SmallFrames
from data_synth.commands.bench.outcome import print_bars_and_curves, say_machine
from lensfit.cli._terminal import progress_bars


def warp(
    out: JsonFolder = None,
    quick: SmallFrames = False,
    as_json: AsJson = False,
) -> None:
    """Warp a frame by lensfit, OpenCV, scikit-image, SciPy and OpenImageIO.

    Example: lensfit bench warp --quick
    """
    from data_synth.bench.warp import bench_warp

    with progress_bars() as progress:
        result = bench_warp(out, quick=quick, progress=progress)
    if as_json:
        typer.echo(json.dumps(result))
        return
    say_machine(result)
    print_bars_and_curves(result)

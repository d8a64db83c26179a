"""`lensfit bench`: measured now, on this machine, next to what others make of it."""

import typer

from lensfit.cli.bench.blur import blur
from lensfit.cli.bench.coverage import coverage
from lensfit.cli.bench.detect import detect
from lensfit.cli.bench.every import every
from lensfit.cli.bench.exchange import exchange
from lensfit.cli.bench.fit import fit
from lensfit.cli.bench.render import render
from lensfit.cli.bench.verdict import verdict
from lensfit.cli.bench.warp import warp
from lensfit.cli.bench.wavefront import wavefront

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

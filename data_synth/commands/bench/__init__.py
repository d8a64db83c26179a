"""`lensfit bench`: measured now, on this machine, next to what others make of it."""

import typer

from data_synth.commands.bench.coverage import coverage
from data_synth.commands.bench.every import every
from data_synth.commands.bench.exchange import exchange
from data_synth.commands.bench.photographs import blur, detect, fit
from data_synth.commands.bench.rendering import render, warp
from data_synth.commands.bench.verdict import verdict
from data_synth.commands.bench.wavefront import wavefront

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

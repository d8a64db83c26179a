"""`lensfit bench`: measured now, on this machine, next to what others make of it."""

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from lensfit.cli._bars import progress_bars
from lensfit.cli._door import say_error

_WIDTH = 150
_VERDICTS = {True: "pass", False: "[bold]falls short[/bold]", None: ""}

app = typer.Typer(no_args_is_help=True, help="Measure lensfit against bars and peers.")


@app.callback()
def _group() -> None:
    pass


@app.command()
def detect(
    data: Annotated[Path, typer.Option("--data", help="Folder with real/ and oracle/")],
    out: Annotated[Path | None, typer.Option("--out", help="Folder for JSON")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the figures as JSON")
    ] = False,
    only: Annotated[
        str | None, typer.Option("--only", help="Name of the one set to measure")
    ] = None,
) -> None:
    """Find and number the marks of sets of photographs; counts and times.

    Example: lensfit bench detect --data data --only dot_pattern_05
    """
    from lensfit.workflow.bench_detect import bench_detect

    with progress_bars() as progress:
        result = bench_detect(data, out, only=only, progress=progress)
    _show(result, as_json)


@app.command()
def fit(
    data: Annotated[Path, typer.Option("--data", help="Folder with real/ and oracle/")],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for JSON and overlays")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the figures as JSON")
    ] = False,
    only: Annotated[
        str | None, typer.Option("--only", help="Name of the one set to measure")
    ] = None,
) -> None:
    """Detect and fit sets of photographs; one row per bar, pass or fall short.

    Falling short is no error; a photograph that cannot be used is, and the exit code
    is then 1.

    Example: lensfit bench fit --data data --only dot_pattern_05
    """
    from lensfit.workflow.bench_fit import bench_fit

    with progress_bars() as progress:
        result = bench_fit(data, out, only=only, progress=progress)
    if as_json:
        typer.echo(json.dumps(result))
    else:
        _print(result)
    for line in result["errors"]:
        say_error(line)
    if result["errors"]:
        raise typer.Exit(1)


@app.command()
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
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the figures as JSON")
    ] = False,
) -> None:
    """Calibrate lenses that an exact ray tracer photographed; judge each by its truth.

    Random lenses are published designs of 14 to 135 mm and f/1.2 to f/8 with the errors
    of a workshop. One row for each lens; the exit code is 1 when one of them failed.

    Example: lensfit bench wavefront --lenses 2 --cases fast --cases jpeg --out bench
    """
    from lensfit.cli._wavefront import judged, trials_of, wavefront_table
    from lensfit.workflow.bench_wavefront import bench_wavefront

    trials = trials_of(lenses, cases or [], size, seed)
    with progress_bars() as progress:
        result = bench_wavefront(trials, judged, out, reuse=reuse, progress=progress)
    if as_json:
        typer.echo(json.dumps(result))
    else:
        _console().print(wavefront_table(result["rows"]))
    for line in result["errors"]:
        say_error(line)
    if result["errors"]:
        raise typer.Exit(1)


@app.command()
def render(
    data: Annotated[
        Path, typer.Option("--data", help="Folder with camera.json, plate, reference")
    ],
    preset: Annotated[
        Path | None, typer.Option("--preset", help="Fitted preset with measured blur")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Folder for JSON")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Leave frames of 8 megapixels out")
    ] = False,
    blender: Annotated[
        str | None,
        typer.Option("--blender", help="Python that has bpy, for Blender's Defocus"),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the figures as JSON")
    ] = False,
) -> None:
    """Render a path-traced scene and synthetic frames; error against time, bars, peers.

    Falling short is no error.

    Example: lensfit bench render --data data/plates --preset takumar_50/preset.json
    """
    from lensfit.cli._render_tables import curve_tables
    from lensfit.workflow.bench_render import bench_render

    with progress_bars() as progress:
        result = bench_render(
            data, out, preset=preset, quick=quick, blender=blender, progress=progress
        )
    if as_json:
        typer.echo(json.dumps(result))
        return
    console = _console()
    console.print(_bars_table(result["rows"]))
    for table in curve_tables(result["curves"]):
        console.print()
        console.print(table)
    for note in result["notes"]:
        console.print(note, markup=False)


@app.command()
def warp(
    out: Annotated[Path | None, typer.Option("--out", help="Folder for JSON")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Leave frames of 8 megapixels out")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the figures as JSON")
    ] = False,
) -> None:
    """Warp a frame by lensfit, OpenCV, scikit-image, SciPy and OpenImageIO.

    Example: lensfit bench warp --quick
    """
    from lensfit.cli._render_tables import curve_tables
    from lensfit.workflow.bench_warp import bench_warp

    with progress_bars() as progress:
        result = bench_warp(out, quick=quick, progress=progress)
    if as_json:
        typer.echo(json.dumps(result))
        return
    _say_machine(result)
    console = _console()
    console.print(_bars_table(result["rows"]))
    for table in curve_tables(result["curves"]):
        console.print()
        console.print(table)


@app.command("all")
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
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the figures as JSON")
    ] = False,
) -> None:
    """Run every benchmark; one table with a row for each bar.

    Example: lensfit bench all --quick --data data
    """
    from lensfit.cli._wavefront import judged, trials_of
    from lensfit.workflow.bench_all import bench_all

    trials = (
        trials_of(0, ["tiny_dots"], "640x480", 0)
        if quick
        else trials_of(3, ["all"], "1024x768", 0)
    )
    with progress_bars() as progress:
        result = bench_all(trials, judged, data, out, quick=quick, progress=progress)
    _show(result, as_json)


def _show(result: dict[str, Any], as_json: bool) -> None:
    """Machine, rows, times and notes; the exit code is 1 when something failed."""
    if as_json:
        typer.echo(json.dumps(result))
    else:
        _say_machine(result)
        _console().print(_bars_table(result["rows"]))
        for name, seconds in result.get("seconds", {}).items():
            typer.echo(f"{name}: {seconds:.0f} s")
        for note in result.get("notes", []):
            typer.echo(note)
    for line in result["errors"]:
        say_error(line)
    if result["errors"]:
        raise typer.Exit(1)


def _say_machine(result: dict[str, Any]) -> None:
    from lensfit.workflow.machine import described

    typer.echo(described(result["machine"]))


def _console():
    from rich.console import Console

    width = None if sys.stdout.isatty() else _WIDTH  # a log is not cut at 80
    return Console(highlight=False, width=width)


def _print(result: dict[str, Any]) -> None:
    console = _console()
    console.print(_bars_table(result["rows"]))
    console.print()
    console.print(_counts_table(result["sets"]))


def _bars_table(rows: list[dict[str, Any]]):
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("set")
    table.add_column("what")
    for name in ("value", "bar", "aim"):
        table.add_column(name, justify="right")
    table.add_column("in the same run")
    table.add_column("verdict")
    for row in rows:
        peers = ", ".join(f"{k} {_figure(v)}" for k, v in row["peers"].items())
        sign = "≥ " if row["least"] else "± " if row["expected"] else "≤ "
        bar = _figure(row["bar"]) if row["bar"] is None else sign + _figure(row["bar"])
        verdict = _VERDICTS[row["passed"]]
        figures = (_figure(row["value"]), bar, _figure(row["aim"]))
        table.add_row(row["set"], row["what"], *figures, peers, verdict)
    return table


def _counts_table(sets: list[dict[str, Any]]):
    from rich.table import Table

    columns = {
        "photographs": "photographs",
        "candidates": "candidates",
        "indexed": "indexed",
        "used": "used",
        "rms_px": "rms px",
        "detect_s": "detect s",
        "first_fit_s": "first fit s",
        "fit_s": "fit s",
    }
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("set")
    for name in columns.values():
        table.add_column(name, justify="right")
    for one in sets:
        table.add_row(one["set"], *(_figure(one[key]) for key in columns))
    return table


def _figure(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "–"
    if value == round(value) and abs(value) < 1e6:
        return f"{value:.0f}"
    return f"{value:.3g}"

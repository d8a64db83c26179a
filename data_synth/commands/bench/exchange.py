"""`lensfit bench exchange`: how near every format of other programs is to a lens."""

import json
from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.bench.outcome import AsJson, fail_if_any
from lensfit.cli._options import size_px
from lensfit.cli._terminal import progress_bars
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.camera import FrameGroup, StateGroup
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup


@takes_groups
def exchange(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    library: LibraryGroup,
    state: StateGroup,
    frame: FrameGroup,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for JSON and the picture")
    ] = None,
    blender: Annotated[
        str | None,
        typer.Option("--blender", help="Python that has bpy, to render with Cycles"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Export a lens in every format, read it back, and print what is lost, in pixels.

    Where a Python has Blender's bpy, Cycles renders through the lens too: a chart,
    lights, the fall-off, and a frame that lensfit renders beside it.

    Example: lensfit bench exchange takumar_50/preset.json
    """
    size = size_px(frame.size)
    from data_synth.bench.exchange import bench_exchange
    from lensfit.exchange.export_request import WantedState
    from lensfit.exchange.samples import ExchangeFrame

    loaded = library.find(preset).preset
    camera = loaded.camera
    wanted = WantedState(state.focal_length_mm, state.f_number, state.focus_distance_mm)
    pixels = ExchangeFrame(
        size or (camera.image_width_px, camera.image_height_px),
        frame.sensor_width_mm or camera.sensor_width_mm,
        frame.overscan,
    )
    with progress_bars() as progress:
        result = bench_exchange(
            loaded, wanted, pixels, out, blender=blender, progress=progress
        )
    if as_json:
        typer.echo(json.dumps(result))
    else:
        _print(result["formats"])
        _print_cycles(result)
    fail_if_any(result["errors"])


def _print_cycles(result: dict) -> None:
    from data_synth.commands.bench.tables import bars_table
    from lensfit.cli._terminal import console

    if result["cycles"]:
        console().print(bars_table(result["cycles"]))
    for note in result["notes"]:
        console().print(note, markup=False)


def _print(rows: list[dict]) -> None:
    from rich.table import Table

    from lensfit.cli._terminal import console

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("format")
    for name in ("landed, rms px", "worst", "straight, rms px", "worst"):
        table.add_column(name, justify="right")
    for name in ("imported, rms px", "worst"):
        table.add_column(name, justify="right")
    for row in rows:
        if "error" in row:
            table.add_row(row["format"], row["error"])
            continue
        parts = (row.get(name, ()) for name in ("landed", "straight", "imported"))
        table.add_row(row["format"], *(f"{px:.2g}" for part in parts for px in part))
        if "rays" in row:
            rays = (f"{px:.2g}" for px in row["rays"])
            table.add_row("  rays of the whole pupil", *rays)
    console().print(table)

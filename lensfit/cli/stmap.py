"""`lensfit stmap`: write the UV maps of a calibrated lens."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._sizes import size_px
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup
from lensfit.cli.groups.pixels import PixelGroup


class Direction(StrEnum):
    """Which maps are written."""

    both = "both"
    undistort = "undistort"
    redistort = "redistort"


@takes_groups
def stmap(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    *,
    library: LibraryGroup,
    out: Annotated[Path, typer.Option("--out", help="Folder for the maps")],
    size: Annotated[
        str | None,
        typer.Option(
            help="Display window, as 4096x3072; that of the photographs by default"
        ),
    ] = None,
    overscan: Annotated[
        float,
        typer.Option(help="Percent beyond the frame in total: 10 is 5 on each side"),
    ] = 0.0,
    direction: Annotated[Direction, typer.Option(help="Which maps")] = Direction.both,
    per_channel: Annotated[
        bool,
        typer.Option(
            "--per-channel",
            help="A map for each of red, green and blue (lateral colour)",
        ),
    ] = False,
    focal_length_mm: Annotated[
        float | None, typer.Option(help="Of the lens, mm")
    ] = None,
    focus_distance_mm: Annotated[
        float | None,
        typer.Option(help="Of the lens, mm from the sensor; inf is allowed"),
    ] = None,
    sensor_width_mm: Annotated[
        float | None, typer.Option(help="Width that the frame spans on the sensor, mm")
    ] = None,
    pixels: PixelGroup,
    tolerance_px: Annotated[
        float, typer.Option(min=1e-7, max=1.0, help="Largest error of the map, px")
    ] = 2.5e-4,
    as_json: Annotated[
        bool, typer.Option("--json", help="Say the outcome as JSON")
    ] = False,
) -> None:
    """Write 32-bit UV maps of a lens, with overscan if wanted.

    NAME_redistort.exr puts the distortion on CG plates, NAME_undistort.exr takes it off
    photographs; values are absolute, origin bottom left, pixel centres at (i + 0.5)/N.

    Example: lensfit stmap takumar/preset.json --size 4096x3072 --out maps
    """
    wanted = size_px(size)
    from lensfit.cli._bars import progress_bars
    from lensfit.cli._door import say_note
    from lensfit.coords import Window
    from lensfit.workflow.plate.pixel_shape import SQUARE, pixel_shape
    from lensfit.workflow.stmaps import StmapFrame, file_stem, write_stmaps

    loaded = library.find(preset).preset
    camera = loaded.camera
    lens = loaded.at(
        focal_length_mm=focal_length_mm, focus_distance_mm=focus_distance_mm
    )
    frame_px = wanted or (camera.image_width_px, camera.image_height_px)
    shape = pixel_shape(
        loaded,
        Window.of_size(*frame_px),
        sensor_width_mm or camera.sensor_width_mm,
        SQUARE,
        pixels.pixel_aspect,
    )
    frame = StmapFrame(frame_px, overscan, sensor_width_mm, shape.ratio)
    with progress_bars() as progress:
        written = write_stmaps(
            lens,
            frame,
            out,
            file_stem(loaded.lens.name, lens),
            direction=direction.value,
            per_channel=per_channel,
            tolerance_px=tolerance_px,
            progress=progress,
        )
    # Of the selection, not of the lens: a map has no blur that could be missing.
    chosen = loaded.select(
        focal_length_mm=focal_length_mm, focus_distance_mm=focus_distance_mm
    )
    for note in filter(None, (*chosen.notes, *written.notes, shape.note)):
        say_note(note)
    if lens.has_lateral_colour and not per_channel:
        say_note("the maps are those of green; --per-channel writes red and blue too")
    _say(written, as_json)


def _say(written, as_json: bool) -> None:
    """The files, and the overscan that CG has to be rendered with."""
    needed = written.margins
    if as_json:
        import json

        outcome = {
            "files": [str(path) for path in written.paths],
            "overscan_needed": {
                **needed._asdict(),
                "factor": written.factor,
                "percent": written.overscan_percent,
            },
        }
        typer.echo(json.dumps(outcome, indent=1))
        return
    for path in written.paths:
        typer.echo(path)
    typer.echo(
        f"CG plates need {written.overscan_percent:.4f} % overscan in total "
        f"(px: left {needed.left}, top {needed.top}, "
        f"right {needed.right}, bottom {needed.bottom})"
    )
    if needed.missing:
        typer.echo("Parts of the frame show nothing that an undistorted plate can hold")

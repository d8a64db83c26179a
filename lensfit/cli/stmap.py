"""`lensfit stmap`: write the UV maps of a calibrated lens."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._options import size_px
from lensfit.cli._terminal import console, say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.camera import CameraGroup, PixelGroup, ScaleToSensorOption
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup

if TYPE_CHECKING:
    from lensfit.preset.scaled_look import ScaledLook
    from lensfit.preset.schema import Preset


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
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the maps")
    ] = None,
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
        bool | None,
        typer.Option(
            "--per-channel/--no-per-channel",
            help="A map for each of red, green and blue (lateral colour); of --plates "
            "where they lie apart visibly, if left out",
        ),
    ] = None,
    plates: Annotated[
        str | None,
        typer.Option(
            help="A map for each frame of plate.####.exr, whose camera is known as in "
            "apply, and the Nuke script that reads them"
        ),
    ] = None,
    frames: Annotated[
        str | None, typer.Option(help="Frames of the plates: 1001-1100x2,1200")
    ] = None,
    map_width: Annotated[
        int | None,
        typer.Option(
            min=16, help="Width of the map, px, where it will be enlarged to the frame"
        ),
    ] = None,
    widths: Annotated[
        bool,
        typer.Option(
            "--widths",
            help="Only say how wrong maps of 512 px and so on are, enlarged",
        ),
    ] = False,
    camera: CameraGroup,
    pixels: PixelGroup,
    scale_to_sensor: ScaleToSensorOption = False,
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

    With --plates there is a map for each frame (NAME_redistort.1001.exr), and NAME.nk.

    Example: lensfit stmap takumar/preset.json --size 4096x3072 --out maps
    """
    wanted = size_px(size)
    if out is None and not widths:
        raise typer.BadParameter("is needed for maps", param_hint="--out")
    if plates is None:
        _refuse_without_plates(camera, frames)
    elif wanted is not None or widths:
        raise typer.BadParameter(
            "goes without --size and --widths", param_hint="--plates"
        )
    loaded = library.find(preset).preset
    chosen = (overscan, map_width, direction.value, per_channel, tolerance_px)
    known = (camera, pixels, scale_to_sensor)
    if plates is not None:
        assert out is not None
        _write_sequence(loaded, plates, frames, out, known, chosen, as_json)
        return
    _write_one(loaded, wanted, out, known, chosen, as_json)


def _refuse_without_plates(camera: CameraGroup, frames: str | None) -> None:
    """Options that describe the frames of a sequence."""
    given = {
        "--frames": frames,
        "--settings": camera.settings,
        "--metadata": camera.metadata,
        "--metadata-start": camera.metadata_start,
        "--camera-name": camera.camera_name,
        "--camera-unit": camera.camera_unit,
    }
    for option, value in given.items():
        if value is not None and value != []:
            raise typer.BadParameter("needs --plates", param_hint=option)


def _write_one(
    loaded: "Preset",
    wanted: tuple[int, int] | None,
    out: Path | None,
    known: tuple[CameraGroup, PixelGroup, bool],
    chosen: tuple,
    as_json: bool,
) -> None:
    """Maps of one state, or how wrong coarser ones are where no folder is given."""
    from lensfit.cli._door import say_note
    from lensfit.cli._terminal import progress_bars
    from lensfit.coords import Window
    from lensfit.exchange.stmaps import StmapFrame, file_stem, write_stmaps
    from lensfit.plate.pixel_shape import SQUARE, pixel_shape

    overscan, map_width, direction, per_channel, tolerance_px = chosen
    camera, pixels, scale_to_sensor = known
    scaled, state, width_mm = _stated_state(loaded, camera, scale_to_sensor)
    lens, own = loaded.at(*state), loaded.camera
    frame_px = wanted or (own.image_width_px, own.image_height_px)
    window, spanned_mm = Window.of_size(*frame_px), width_mm or own.sensor_width_mm
    shape = pixel_shape(loaded, window, spanned_mm, SQUARE, pixels.pixel_aspect)
    frame = StmapFrame(
        frame_px,
        overscan,
        width_mm,
        shape.ratio,
        map_width,
        scaled=scaled,
        pixel_aspect=pixels.pixel_aspect or SQUARE,
    )
    if out is None:
        _say_widths(lens, frame, tolerance_px, as_json)
        return
    with progress_bars() as progress:
        written = write_stmaps(
            lens,
            frame,
            out,
            file_stem(loaded.lens.name, lens, scaled),
            direction=direction,
            per_channel=bool(per_channel),
            tolerance_px=tolerance_px,
            progress=progress,
        )
    # Of the selection, not of the lens: a map has no blur that could be missing.
    notes = [scaled.note, *loaded.select(*state).notes, *written.notes, shape.note]
    if lens.has_lateral_colour and not per_channel:
        notes.append(_ONE_MAP)
    for note in filter(None, notes):
        say_note(note)
    _say(written, as_json)


_ONE_MAP = "the maps are those of green; --per-channel writes red and blue too"


def _stated_state(
    loaded: "Preset", camera: CameraGroup, scale_to_sensor: bool
) -> tuple["ScaledLook", tuple[float | None, None, float | None], float | None]:
    """How the look is scaled, the state of the measured lens, and the sensor's width
    that the frame spans there."""
    from lensfit.preset.scaled_look import UNSCALED, scaled_look

    focal, width_mm, scaled = camera.focal_length_mm, camera.sensor_width_mm, UNSCALED
    if scale_to_sensor:
        scaled = scaled_look(loaded, focal, width_mm)
    if scaled != UNSCALED:
        width_mm = scaled.measured_width_mm
    focal, focus = scaled.measured_state(focal, camera.focus_distance_mm)
    return scaled, (focal, None, focus), width_mm


def _write_sequence(
    loaded: "Preset",
    plates: str,
    frames: str | None,
    out: Path,
    known: tuple[CameraGroup, PixelGroup, bool],
    chosen: tuple,
    as_json: bool,
) -> None:
    """A map for each frame of plates."""
    from lensfit.cli._door import say_note
    from lensfit.cli._terminal import progress_bars
    from lensfit.plate.apply_options import ApplyOptions
    from lensfit.rendering.render_stages import Switches
    from lensfit.workflow.moving_stmaps import write_moving_stmaps

    overscan, map_width, direction, per_channel, tolerance_px = chosen
    camera, pixels, scale_to_sensor = known
    options = ApplyOptions(
        overrides=camera.overrides(),
        camera=camera.sources(),
        pixel_aspect=pixels.pixel_aspect,
        switches=Switches(falloff=False, defocus=False),
        again=True,  # a finished frame has the camera of its plate
        scale_to_sensor=scale_to_sensor,
    )
    with progress_bars() as progress:
        written = write_moving_stmaps(
            loaded,
            plates,
            out,
            options=options,
            frames=frames,
            overscan_percent=overscan,
            map_width_px=map_width,
            direction=direction,
            per_channel=per_channel,
            tolerance_px=tolerance_px,
            progress=progress,
        )
    for note in written.notes:
        say_note(note)
    _say_sequence(written, out, as_json)


def _say_sequence(written, out: Path, as_json: bool) -> None:
    """The script, and what it reads."""
    if as_json:
        import json

        outcome = {
            "files": [str(path) for path in written.paths],
            "script": str(written.script),
            "different": written.different,
            "per_channel": written.per_channel,
            "overscan_needed": {"percent": written.overscan_percent},
        }
        typer.echo(json.dumps(outcome, indent=1))
        return
    say_line(written.script)
    each = ", each colour its own" if written.per_channel else ""
    say_line(
        f"{len(written.paths)} maps of {written.different} states in {out}{each}; CG "
        f"plates need {written.overscan_percent:.4f} % overscan in total"
    )


def _say_widths(lens, frame, tolerance_px: float, as_json: bool) -> None:
    """The error of maps that are coarser than the frame."""
    from lensfit.cli._door import say_note
    from lensfit.workflow.stmap_widths import width_errors

    if frame.scaled.note is not None:
        say_note(frame.scaled.note)
    found = width_errors(lens, frame, tolerance_px)
    if as_json:
        import json

        typer.echo(json.dumps([one._asdict() for one in found], indent=1))
        return
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("map")
    for kind in ("linear", "Keys' cubic"):
        table.add_column(f"{kind}, rms px", justify="right")
        table.add_column("worst px", justify="right")
    for one in found:
        size = f"{one.width_px} x {one.height_px}"
        table.add_row(size, *(f"{error:.2g}" for error in one[2:]))
    console().print(table)


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
        say_line(path)
    say_line(
        f"CG plates need {written.overscan_percent:.4f} % overscan in total "
        f"(px: left {needed.left}, top {needed.top}, "
        f"right {needed.right}, bottom {needed.bottom})"
    )
    if needed.missing:
        say_line("Parts of the frame show nothing that an undistorted plate can hold")

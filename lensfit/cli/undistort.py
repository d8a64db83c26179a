"""`lensfit undistort`: take a calibrated lens off photographed plates."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli.apply import FilterOption, ProgressName, begin_frames, say_applied
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.camera import CameraGroup, PixelGroup
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup
from lensfit.cli.groups.rendering import CoresOption, ToleranceOption

if TYPE_CHECKING:
    from lensfit.rendering.render_stages import Switches


@takes_groups
def undistort(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    plates: Annotated[
        str, typer.Argument(help="EXR plate, or plate.####.exr for a sequence")
    ],
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results")],
    frames: Annotated[
        str | None, typer.Option(help="Frames of the sequence: 1001-1100x2,1200")
    ] = None,
    lateral_colour: Annotated[
        bool,
        typer.Option(
            "--lateral-colour", help="Take it off too: red and blue onto green"
        ),
    ] = False,
    falloff: Annotated[
        bool,
        typer.Option("--falloff", help="Take it off too (needs the f-number)"),
    ] = False,
    overscan: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=200.0,
            help="Same window for every frame, percent beyond it in total; as large as "
            "each straight picture if left out",
        ),
    ] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Frames rendered at the same time")
    ] = 1,
    cores: CoresOption = None,
    library: LibraryGroup,
    camera: CameraGroup,
    pixels: PixelGroup,
    layer: Annotated[
        list[str] | None,
        typer.Option(
            help="Straighten only this layer; repeat for more ('' is the main one)"
        ),
    ] = None,
    tolerance: ToleranceOption = 1e-3,
    filter_name: FilterOption = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Make every frame again")
    ] = False,
    keep: Annotated[
        bool,
        typer.Option("--keep", help="Refuse to replace frames made otherwise"),
    ] = False,
    again: Annotated[
        bool,
        typer.Option("--again", help="Straighten plates that are straight already"),
    ] = False,
    progress_as: Annotated[
        ProgressName, typer.Option("--progress", help="How far it is; see apply")
    ] = ProgressName.auto,
    as_json: Annotated[
        bool, typer.Option("--json", help="Say the outcome as JSON")
    ] = False,
) -> None:
    """Straighten photographed plates, and write the pinhole camera that is left.

    Results have the data window of the whole straightened photograph; NAME.camera.json
    beside them has focal length in pixels, principal point and film back of every
    frame. `lensfit apply` with the same effects is the inverse.

    Example: lensfit undistort takumar/preset.json A001.####.exr --out straight
    """
    from lensfit.cli._terminal import frame_progress

    begin_frames(keep, overwrite, cores)
    from lensfit.plate.apply_options import ApplyOptions
    from lensfit.workflow.undistort import undistort_plates

    options = ApplyOptions(
        overrides=camera.overrides(),
        camera=camera.sources(),
        pixel_aspect=pixels.pixel_aspect,
        switches=_switches(lateral_colour, falloff),
        output="undistorted",
        straight_overscan_percent=overscan,
        layers=layer or None,
        tolerance=tolerance,
        method=None if filter_name is None else filter_name.value,
        overwrite=overwrite,
        keep=keep,
        again=again,
    )
    with frame_progress(progress_as.value) as (progress, frame_done):
        applied, cameras = undistort_plates(
            library.find(preset).preset,
            plates,
            out,
            options=options,
            frames=frames,
            workers=workers,
            progress=progress,
            frame_done=frame_done,
        )
    say_applied(applied, out, as_json, cameras)
    if applied.failures:
        raise typer.Exit(1)


def _switches(lateral_colour: bool, falloff: bool) -> "Switches":
    """What is taken off; nothing of the blur can be."""
    from lensfit.rendering.render_stages import Switches

    return Switches(lateral_colour=lateral_colour, falloff=falloff, defocus=False)

"""`lensfit apply`: put a calibrated lens on CG plates."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._terminal import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.camera import (
    CameraGroup,
    FocusGroup,
    PixelGroup,
    ScaleToSensorOption,
)
from lensfit.cli.groups.knobs import (
    AberrationGroup,
    BokehGroup,
    LookGroup,
    stated_knobs,
)
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup
from lensfit.cli.groups.rendering import (
    CoresOption,
    DepthGroup,
    DisableGroup,
    EffectsGroup,
    ToleranceOption,
)

if TYPE_CHECKING:
    from lensfit.plate.apply_options import ApplyOptions
    from lensfit.workflow.apply import Applied


class FilterName(StrEnum):
    """Interpolating filters of `lensfit.rendering.filters`."""

    cubic = "cubic"
    catmull_rom = "catmull-rom"
    keys_6 = "keys-6"
    sinc_16 = "sinc-16"


FilterOption = Annotated[
    FilterName | None,
    typer.Option("--filter", help="Of the warp; chosen by the tolerance if left out"),
]


class ProgressName(StrEnum):
    """How progress is told, as in `lensfit.cli._terminal`."""

    auto = "auto"
    bar = "bar"
    lines = "lines"
    openjd = "openjd"
    none = "none"


class OutputName(StrEnum):
    """What is written, as in `lensfit.plate.frame.explaining_picture`."""

    result = "result"
    circle_of_confusion = "circle-of-confusion"
    aberration_dots = "aberration-dots"
    filter = "filter"


@takes_groups
def apply(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    plates: Annotated[
        str, typer.Argument(help="EXR plate, or plate.####.exr for a sequence")
    ],
    *,
    out: Annotated[Path, typer.Option("--out", help="Folder for the results")],
    frames: Annotated[
        str | None, typer.Option(help="Frames of the sequence: 1001-1100x2,1200")
    ] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Frames rendered at the same time")
    ] = 1,
    cores: CoresOption = None,
    output: Annotated[
        OutputName, typer.Option(help="The result, or a picture that explains it")
    ] = OutputName.result,
    library: LibraryGroup,
    camera: CameraGroup,
    focus: FocusGroup,
    pixels: PixelGroup,
    depth: DepthGroup,
    effects: EffectsGroup,
    aberrations: AberrationGroup,
    disabled: DisableGroup,
    bokeh: BokehGroup,
    look: LookGroup,
    keep_overscan: Annotated[
        bool,
        typer.Option(
            "--keep-overscan",
            help="Write the plate's data window, not only the display window",
        ),
    ] = False,
    scale_to_sensor: ScaleToSensorOption = False,
    stmap: Annotated[
        Path | None,
        typer.Option(help="Redistort map (EXR) in place of the lens' own distortion"),
    ] = None,
    layer: Annotated[
        list[str] | None,
        typer.Option(
            help="Render only this layer; repeat for more ('' is the main one)"
        ),
    ] = None,
    tolerance: ToleranceOption = 3e-3,
    filter_name: FilterOption = None,
    overwrite: Annotated[
        bool,
        typer.Option(
            "--overwrite", help="Render every frame again, whatever is there already"
        ),
    ] = False,
    keep: Annotated[
        bool,
        typer.Option(
            "--keep",
            help="Refuse to replace finished frames of another plate, preset or "
            "settings; otherwise these are rendered again",
        ),
    ] = False,
    again: Annotated[
        bool,
        typer.Option("--again", help="Render plates that carry a lens already"),
    ] = False,
    progress_as: Annotated[
        ProgressName,
        typer.Option(
            "--progress",
            help="How far it is, on standard error: a bar, a line per frame (auto: "
            "a bar on a terminal, or else lines), or what a farm reads",
        ),
    ] = ProgressName.auto,
    as_json: Annotated[
        bool, typer.Option("--json", help="Say the outcome as JSON")
    ] = False,
) -> None:
    """Put distortion, lateral colour, depth of field and fall-off on CG plates.

    The camera state comes from each plate's header; lensfit.toml, sidecar and camera
    files and options count in its place, in rising order. Colour
    layers are rendered, every other channel and Cryptomatte keep their bits. Depth of
    field needs a depth channel, or deep pixels. A finished frame is skipped if it is
    what would be rendered now; a bad one is reported, and the others go on.

    Example: lensfit apply takumar/preset.json plate.####.exr --out rendered
    """
    from lensfit.cli._terminal import frame_progress

    begin_frames(keep, overwrite, cores)
    from lensfit.workflow.apply import apply

    options = apply_options(
        output=output,
        camera=camera,
        focus=focus,
        pixels=pixels,
        depth=depth,
        effects=effects,
        aberrations=aberrations,
        disabled=disabled,
        bokeh=bokeh,
        look=look,
        keep_overscan=keep_overscan,
        scale_to_sensor=scale_to_sensor,
        stmap=stmap,
        layer=layer,
        tolerance=tolerance,
        filter_name=filter_name,
        overwrite=overwrite,
        keep=keep,
        again=again,
    )
    with frame_progress(progress_as.value) as (progress, frame_done):
        applied = apply(
            library.find(preset).preset,
            plates,
            out,
            frames=frames,
            options=options,
            workers=workers,
            progress=progress,
            frame_done=frame_done,
        )
    say_applied(applied, out, as_json)
    if applied.failures:
        raise typer.Exit(1)


def begin_frames(keep: bool, overwrite: bool, cores: int | None) -> None:
    """Refuse options that exclude each other, and limit the cores before JAX is loaded.

    Raises
    ------
    typer.BadParameter : Finished frames are both to be kept and to be replaced.
    """
    from lensfit.cores import limit_cores

    if keep and overwrite:
        raise typer.BadParameter("goes without --overwrite", param_hint="--keep")
    if cores is not None:
        limit_cores(cores)


def apply_options(
    *,
    output: OutputName,
    camera: CameraGroup,
    focus: FocusGroup,
    pixels: PixelGroup,
    depth: DepthGroup,
    effects: EffectsGroup,
    aberrations: AberrationGroup,
    disabled: DisableGroup,
    bokeh: BokehGroup,
    look: LookGroup,
    keep_overscan: bool,
    scale_to_sensor: bool,
    stmap: Path | None,
    layer: list[str] | None,
    tolerance: float,
    filter_name: FilterName | None,
    overwrite: bool,
    keep: bool,
    again: bool,
    **others: object,
) -> "ApplyOptions":
    """How plates are to be rendered, from the values of this command's options.

    Parameters
    ----------
    others : Those that say nothing of it.
    """
    from lensfit.plate.apply_options import ApplyOptions

    return ApplyOptions(
        overrides=camera.overrides(),
        camera=camera.sources(focus.pick()),
        pixel_aspect=pixels.pixel_aspect,
        switches=effects.switches(),
        depth=depth.options(),
        edge_mask=depth.edge_objects,
        edge_matte=depth.edge_matte,
        knobs=stated_knobs(aberrations, bokeh, look) | disabled.gains,
        output=output.value,
        keep_overscan=keep_overscan,
        scale_to_sensor=scale_to_sensor,
        layers=layer or None,
        stmap=stmap,
        tolerance=tolerance,
        method=None if filter_name is None else filter_name.value,
        overwrite=overwrite,
        keep=keep,
        again=again,
    )


def say_applied(
    applied: "Applied", out: Path, as_json: bool, cameras: Path | None = None
) -> None:
    """The outcome: results on standard output, remarks and failures on the other.

    Parameters
    ----------
    cameras : File with the cameras of the results, if there is one.
    """
    from lensfit.cli._door import say_error, say_note

    for note in applied.notes:
        say_note(note)
    for failure in applied.failures:
        say_error(failure)
    if as_json:
        import json

        outcome = {
            "written": [str(path) for path in applied.written],
            "skipped": [str(path) for path in applied.skipped],
            "failures": applied.failures,
            "notes": applied.notes,
            "seconds": round(applied.seconds, 3),
        }
        outcome |= {} if cameras is None else {"cameras": str(cameras)}
        typer.echo(json.dumps(outcome, indent=1))
        return
    count = len(applied.written)
    text = f"{count} {'frame' if count == 1 else 'frames'} written"
    if count:
        rate = count / applied.seconds
        text += f" to {out} in {applied.seconds:.1f} s ({rate:.2f} frames/s)"
    if applied.skipped:
        text += f", {len(applied.skipped)} finished before"
    if applied.failures:
        text += f", {len(applied.failures)} failed"
    say_line(text)
    if cameras is not None:
        say_line(cameras)

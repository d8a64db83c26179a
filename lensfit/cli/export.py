"""`lensfit export`: hand a lens to another program."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._options import size_px
from lensfit.cli._terminal import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.camera import FrameGroup, StateGroup
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup

if TYPE_CHECKING:
    from lensfit.exchange.export_request import Exported


class ExportFormat(StrEnum):
    """As in `lensfit.exchange.export.FORMATS`."""

    nuke_radial = "nuke-radial"
    nuke_anamorphic = "nuke-anamorphic"
    nuke_anamorphic_rescaled = "nuke-anamorphic-rescaled"
    opentrackio = "opentrackio"
    opencv = "opencv"
    usd = "usd"
    mrcal_opencv = "mrcal-opencv"
    mrcal_splined = "mrcal-splined"
    unreal = "unreal"
    syntheyes = "syntheyes"
    lensfun = "lensfun"
    stmap = "stmap"
    nuke_stmap = "nuke-stmap"
    cycles_osl = "cycles-osl"


@takes_groups
def export(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    to: Annotated[ExportFormat, typer.Option("--to", help="What to write")],
    out: Annotated[
        Path, typer.Option("--out", help="File to write; for stmap the folder")
    ],
    library: LibraryGroup,
    state: StateGroup,
    frame: FrameGroup,
    per_channel: Annotated[
        bool,
        typer.Option("--per-channel", help="Maps for each of red, green and blue"),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Say the outcome as JSON")
    ] = False,
) -> None:
    """Write a lens for another program, and print the error of its model, in pixels.

    UV maps (stmap, nuke-stmap) are exact; the others are fitted to the lens over frame
    and overscan. cycles-osl is the whole lens, blur too, as a camera of Blender.
    lensfun, opentrackio and unreal get all entries unless one is requested.

    Example: lensfit export takumar/preset.json --to nuke-radial --out takumar.nk
    """
    size = size_px(frame.size)
    from lensfit.cli._door import say_note
    from lensfit.cli._terminal import progress_bars
    from lensfit.exchange.export import export_preset
    from lensfit.exchange.export_request import ExportRequest, WantedState
    from lensfit.exchange.samples import ExchangeFrame

    loaded = library.find(preset).preset
    camera = loaded.camera
    with progress_bars() as progress:
        written = export_preset(
            to.value,
            ExportRequest(
                preset=loaded,
                state=WantedState(
                    state.focal_length_mm, state.f_number, state.focus_distance_mm
                ),
                frame=ExchangeFrame(
                    size or (camera.image_width_px, camera.image_height_px),
                    frame.sensor_width_mm or camera.sensor_width_mm,
                    frame.overscan,
                ),
                out=out,
                per_channel=per_channel,
                progress=progress,
            ),
        )
    for note in written.notes:
        say_note(note)
    _say(written, as_json)


def _say(written: "Exported", as_json: bool) -> None:
    if as_json:
        import json

        residuals = [
            {"what": one.what}
            | (one.residual._asdict() if one.residual else {})
            | ({} if one.worst_light is None else {"worst_light": one.worst_light})
            for one in written.nearness
        ]
        outcome = {
            "files": [str(path) for path in written.paths],
            "residuals": residuals,
            "notes": list(written.notes),
        }
        typer.echo(json.dumps(outcome, indent=1))
        return
    for path in written.paths:
        say_line(path)
    for one in written.nearness:
        say_line(str(one))

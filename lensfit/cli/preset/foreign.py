"""`lensfit preset import`, `thin-lens`: lenses of other programs as presets."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._options import size_px
from lensfit.cli._terminal import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.camera import StateGroup

if TYPE_CHECKING:
    from lensfit.exchange.imports import Imported


class ImportFormat(StrEnum):
    """As in `lensfit.exchange.imports.FOREIGN_FORMATS`."""

    stmap = "stmap"
    usd = "usd"
    mrcal = "mrcal"
    unreal = "unreal"
    opentrackio = "opentrackio"
    syntheyes = "syntheyes"
    lensfun = "lensfun"
    nuke = "nuke"
    opencv = "opencv"


class MapDirection(StrEnum):
    """What applying a UV map does."""

    undistort = "undistort"
    redistort = "redistort"


@takes_groups
def import_lens(
    file: Annotated[
        Path,
        typer.Argument(
            help="OpenCV YAML or XML, lensfun XML, OpenTrackIO JSON, Nuke script with "
            "a 3DEqualizer lens node, USD camera with OpenCV's lens, mrcal "
            ".cameramodel, Unreal .ulens, SynthEyes .lni, or UV map (EXR)"
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Preset to write")],
    state: StateGroup,
    kind: Annotated[
        ImportFormat | None,
        typer.Option("--from", help="What the file is; found from its content"),
    ] = None,
    sensor_width_mm: Annotated[
        float | None,
        typer.Option(min=0.01, help="Width that the picture spans on the sensor, mm"),
    ] = None,
    size: Annotated[
        str | None, typer.Option(help="Of the picture in pixels, as 4096x3072")
    ] = None,
    lens: Annotated[
        str | None,
        typer.Option(help="Part of the name, where a file holds several lenses"),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(help="Part of the name of a camera in a lensfun database"),
    ] = None,
    direction: Annotated[
        MapDirection | None,
        typer.Option(help="Of a UV map: undistort holds distorted positions"),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Say the outcome as JSON")
    ] = False,
) -> None:
    """Make a preset of another program's lens, and print its error, in pixels.

    Example: lensfit preset import camera.yaml --sensor-width-mm 24 --out lens.json
    """
    wanted = size_px(size)
    from lensfit.cli._door import say_note
    from lensfit.cli._terminal import progress_bars
    from lensfit.exchange.foreign import StatedValues
    from lensfit.exchange.imports import import_preset
    from lensfit.preset.store import save_preset

    with progress_bars() as progress:
        found = import_preset(
            file,
            StatedValues(
                sensor_width_mm,
                state.focal_length_mm,
                state.focus_distance_mm,
                state.f_number,
                wanted,
                lens,
                None if direction is None else direction.value,
            ),
            kind=None if kind is None else kind.value,
            camera=camera,
            progress=progress,
        )
    save_preset(found.preset, out)
    for note in found.notes:
        say_note(note)
    _say(found, out, as_json)


def _say(found: "Imported", out: Path, as_json: bool) -> None:
    if as_json:
        import json

        entries = [
            {
                "entry": fit.state,
                "distortion": fit.distortion._asdict(),
                "lateral_colour": fit.colour._asdict() if fit.colour else None,
                "worst_light": fit.worst_light,
            }
            for fit in found.fits
        ]
        outcome = {"file": str(out), "entries": entries, "notes": list(found.notes)}
        typer.echo(json.dumps(outcome, indent=1))
        return
    say_line(f"{out}: {found.preset.lens.name}")
    for fit in found.fits:
        colour = f"; lateral colour: {fit.colour}" if fit.colour else ""
        light = fit.worst_light
        said = "" if light is None else f"; fall-off: worst {100 * light:.2g} %"
        say_line(f"{fit.state}: distortion: {fit.distortion}{colour}{said}")


def thin_lens(
    camera: Annotated[Path, typer.Argument(help="camera.json of a CG renderer")],
    out: Annotated[Path, typer.Option("--out", help="Preset to write")],
) -> None:
    """Make an ideal lens: defocus and nothing else, as a CG renderer's thin lens.

    The file states focal_length_mm, f_number, focus_distance_m (from the lens),
    sensor_width_mm, width_px and height_px.

    Example: lensfit preset thin-lens camera.json --out thin.json
    """
    from lensfit._strict import convert_strictly, read_json_object
    from lensfit.errors import PresetError
    from lensfit.preset.store import save_preset
    from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset

    tables = read_json_object(
        camera,
        error=PresetError,
        source="give the camera.json of the plate",
        mend="mend the file",
    )
    stated = convert_strictly(tables, ThinCamera, error=PresetError, where=camera)
    save_preset(thin_lens_preset(stated), out)
    say_line(f"{out}: thin lens {stated.focal_length_mm:g} mm f/{stated.f_number:g}")

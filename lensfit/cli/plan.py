"""`lensfit plan`: what a plate needs from a lens, and what it costs."""

import json
from typing import Annotated

import typer

from lensfit.cli._terminal import console
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


@takes_groups
def plan(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    plate: Annotated[
        str, typer.Argument(help="EXR plate, or plate.####.exr for its first frame")
    ],
    *,
    tolerance: ToleranceOption = 3e-3,
    cores: CoresOption = None,
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
    scale_to_sensor: ScaleToSensorOption = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print which stages a plate needs, which are left out and why, error and time.

    Example: lensfit plan takumar_50/preset.json plate.1001.exr --tolerance 3e-3
    """
    from lensfit.cli._door import say_note
    from lensfit.cli._terminal import progress_bars
    from lensfit.plate.apply_options import ApplyOptions
    from lensfit.workflow.plan_plate import plan_plate

    options = ApplyOptions(
        overrides=camera.overrides(),
        camera=camera.sources(focus.pick()),
        pixel_aspect=pixels.pixel_aspect,
        switches=effects.switches(),
        depth=depth.options(),
        edge_mask=depth.edge_objects,
        edge_matte=depth.edge_matte,
        knobs=stated_knobs(aberrations, bokeh, look) | disabled.gains,
        tolerance=tolerance,
        scale_to_sensor=scale_to_sensor,
    )
    with progress_bars() as progress:
        lens = library.find(preset).preset
        found, notes = plan_plate(lens, plate, options, progress, cores=cores)
    if as_json:
        typer.echo(json.dumps(found.facts() | {"notes": notes}))
        return
    _print(found)
    for note in notes:
        say_note(note)


def _count(cores: int) -> str:
    return "1 core" if cores == 1 else f"{cores} cores"


def _print(found) -> None:
    from rich.table import Table
    from rich.text import Text

    from lensfit.printable import printable

    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("stage", "", "why"):
        table.add_column(name)
    table.add_column("error", justify="right")
    table.add_column("seconds", justify="right")
    for stage in found.stages:
        table.add_row(
            stage.stage,
            "run" if stage.runs else "left out",
            Text(printable(stage.reason)),
            f"{stage.error:.1e}" if stage.error else "–",
            f"{stage.seconds:.2f}" if stage.seconds else "–",
        )
    more = f"; the first frame {found.first_s:.0f} s more" if found.first_s >= 1 else ""
    table.add_row(
        "all",
        "",
        f"tolerance {found.tolerance:g}{more}; {found.gib:.1f} GiB "
        f"on {_count(found.cores)}",
        f"{found.error:.1e}",
        f"{found.seconds:.2f}",
    )
    console().print(table)

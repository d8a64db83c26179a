"""`lensfit synth scene`: a CG scene, and its photograph by exact ray tracing."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.prescriptions import settable_prescription
from lensfit.cli._options import photograph_size_px


def scene(
    lens: Annotated[
        str, typer.Option("--lens", help="A bundled lens, or a prescription file")
    ],
    out: Annotated[Path, typer.Option(help="Folder to write to")] = Path("scene"),
    size: Annotated[str, typer.Option(help="Pixels, WIDTHxHEIGHT")] = "960x540",
    f_number: Annotated[
        float | None, typer.Option(help="The lens' widest by default")
    ] = None,
    focus_distance_mm: Annotated[
        float | None,
        typer.Option(help="From the sensor; 24 focal lengths by default"),
    ] = None,
    focal_length_mm: Annotated[
        float | None, typer.Option(help="Nearest published state of a zoom")
    ] = None,
    rays: Annotated[
        int,
        typer.Option(min=1, max=4096, help="Per pixel and channel, about"),
    ] = 96,
    seed: Annotated[int, typer.Option(min=0, help="Of the scene and the rays")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Draw a random CG scene and photograph it through a published lens.

    Writes the photograph (photo_reference.exr), the pinhole plates that belong to it
    (cg_flat.exr with Z, cg_layerNN.exr, cg_deep.exr), and scene.json.

    Example: lensfit synth scene --lens biotar_50 --f-number 2 --seed 3 --out scene
    """
    from data_synth.scene.folder import SCENE_FILE, drawn_sitting, write_scene
    from data_synth.scene.sampling import sampling_of
    from data_synth.wavefront_cases import frame_for

    prescription = settable_prescription(
        "--lens", lens, f_number, "--focus-distance-mm", focus_distance_mm
    )
    state = prescription.state_nearest(focal_length_mm)
    sitting = drawn_sitting(
        prescription,
        frame_for(prescription, photograph_size_px(size)),
        focus_distance_mm=focus_distance_mm or 24 * state.focal_length_mm,
        f_number=f_number,
        focal_length_mm=focal_length_mm,
        seed=seed,
    )
    write_scene(out, sitting, sampling_of(rays), seed=seed, progress=_say_on_terminal)
    written = str(out / SCENE_FILE)
    typer.echo(json.dumps({"scene": written}) if as_json else written)


def _say_on_terminal(what: str) -> None:
    if sys.stderr.isatty():
        typer.echo(what, err=True)

"""`lensfit bench render`, `warp`: error against time of the renderer, beside peers.

`warp` compares one warp with what a user would pick instead.
"""

import json
from pathlib import Path
from typing import Annotated

import typer

from data_synth.commands.bench.outcome import (
    AsJson,
    JsonFolder,
    SmallFrames,
    print_bars_and_curves,
    say_machine,
)
from lensfit.cli._terminal import console, progress_bars


def render(
    data: Annotated[
        Path, typer.Option("--data", help="Folder with plates/ and oracle/")
    ],
    preset: Annotated[
        Path | None, typer.Option("--preset", help="Fitted preset with measured blur")
    ] = None,
    scene: Annotated[
        Path | None,
        typer.Option(
            "--scene", help="One more scene, photographed by the lens of --preset"
        ),
    ] = None,
    out: JsonFolder = None,
    quick: SmallFrames = False,
    blender: Annotated[
        str | None,
        typer.Option("--blender", help="Python that has bpy, for Blender's Defocus"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Render a path-traced scene and synthetic frames; error against time, bars, peers.

    Falling short is no error.

    Example: lensfit bench render --data data
    """
    from data_synth.bench.render.benchmark import bench_render

    with progress_bars() as progress:
        result = bench_render(
            data,
            out,
            preset=preset,
            scene=scene,
            quick=quick,
            blender=blender,
            progress=progress,
        )
    if as_json:
        typer.echo(json.dumps(result))
        return
    say_machine(result)
    print_bars_and_curves(result)
    for note in result["notes"]:
        console().print(note, markup=False)


def warp(
    out: JsonFolder = None,
    quick: SmallFrames = False,
    as_json: AsJson = False,
) -> None:
    """Warp a frame by lensfit, OpenCV, scikit-image, SciPy and OpenImageIO.

    Example: lensfit bench warp --quick
    """
    from data_synth.bench.warp import bench_warp

    with progress_bars() as progress:
        result = bench_warp(out, quick=quick, progress=progress)
    if as_json:
        typer.echo(json.dumps(result))
        return
    say_machine(result)
    print_bars_and_curves(result)

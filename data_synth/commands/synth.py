"""`lensfit synth`: photographs by an exact ray tracer, with their truth.

`charts` photographs charts, `scene` a CG scene.
"""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from data_synth.commands.prescriptions import settable_prescription
from lensfit.cli._door import one_of
from lensfit.cli._options import photograph_size_px

if TYPE_CHECKING:
    from data_synth.prescription import Prescription
    from data_synth.sensor import Frame

KINDS = ("dot-grid", "line-grid", "checkerboard")
FORMATS = ("exr", "png16", "png", "jpg")


def charts(
    lens: Annotated[
        str | None, typer.Argument(help="A bundled lens, or a prescription file")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder to write to")] = Path("synth"),
    size: Annotated[str, typer.Option(help="Pixels, WIDTHxHEIGHT")] = "1280x960",
    f_number: Annotated[
        float | None, typer.Option(help="Two stops from widest by default")
    ] = None,
    focus: Annotated[
        float | None, typer.Option(help="Focus distance from the sensor, mm")
    ] = None,
    target: Annotated[
        str, typer.Option(help=" | ".join(KINDS), callback=one_of(KINDS))
    ] = "dot-grid",
    picture: Annotated[
        str,
        typer.Option("--format", help=" | ".join(FORMATS), callback=one_of(FORMATS)),
    ] = "exr",
    wavefront: Annotated[
        bool,
        typer.Option("--wavefront", help="Dots in and out of focus, at two stops"),
    ] = False,
    bayer: Annotated[bool, typer.Option("--bayer", help="Through a mosaic")] = False,
    seed: Annotated[int, typer.Option(help="Of rays and noise")] = 0,
    list_lenses: Annotated[
        bool, typer.Option("--list", help="Name the bundled lenses")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Photograph a chart through a published lens, by exact ray tracing.

    Writes the photographs, a shoot.toml for `lensfit calibrate`, and what only the ray
    tracer knows (*_truth.json). With --wavefront the takes show the shape of spots, and
    the true spots are written too (truth_wavefront.npz).

    Example: lensfit synth nikkor_28 --out shoot --size 1280x960 --f-number 5.6
    """
    from data_synth.plan import planned_shots
    from data_synth.sensor import Sensor
    from data_synth.shoot import Camera, write_shoot

    if list_lenses:
        _print_lenses(as_json)
        return
    prescription = _prescription(lens, f_number, focus)
    if wavefront:
        if focus is not None or target != "dot-grid":
            raise typer.BadParameter("--wavefront chooses --focus and --target itself")
        takes = _write_wavefront(
            out, prescription, f_number, size, picture, bayer, seed
        )
        _say_written(out, takes, as_json)
        return
    frame = _frame(size, prescription)
    shots = planned_shots(
        prescription,
        frame,
        kind=target,  # pyright: ignore[reportArgumentType]
        f_number=f_number,
        focus_distance_mm=focus,
        form=picture,  # pyright: ignore[reportArgumentType]
    )
    camera = Camera(frame, Sensor(bayer=bayer))
    write_shoot(out, prescription, camera, shots, seed=seed, progress=_say_photographed)
    _say_written(out, [shot.name for shot in shots], as_json)


def _write_wavefront(
    out: Path,
    prescription: "Prescription",
    f_number: float | None,
    size: str,
    picture: str,
    bayer: bool,
    seed: int,
) -> list[str]:
    """A shoot that shows the wavefront, and its truth; returns the takes' names."""
    import dataclasses

    from data_synth.sensor import Sensor
    from data_synth.wavefront_cases import subject_of
    from data_synth.wavefront_plan import WavefrontPlan

    widest = prescription.f_number if f_number is None else f_number
    subject = subject_of(
        dataclasses.replace(prescription, f_number=widest),
        photograph_size_px(size),
        WavefrontPlan(form=picture),  # pyright: ignore[reportArgumentType]
        Sensor(bayer=bayer),
    )
    subject.write(out, seed=seed, progress=_say_photographed)
    return [shot.name for shot in subject.shots()]


def _say_written(out: Path, takes: list[str], as_json: bool) -> None:
    written = {"shoot": str(out / "shoot.toml"), "takes": takes}
    typer.echo(json.dumps(written) if as_json else written["shoot"])


def _say_photographed(name: str) -> None:
    _say_on_terminal(f"photographing {name}")


def _print_lenses(as_json: bool) -> None:
    from data_synth.prescription import load_prescription, prescription_names

    lenses = [load_prescription(name) for name in prescription_names()]
    if as_json:
        rows = [
            {"name": p.name, "title": p.title, "source": p.source, "squeeze": p.squeeze}
            for p in lenses
        ]
        typer.echo(json.dumps(rows))
        return
    for prescription in lenses:
        typer.echo(
            f"{prescription.name:18} {prescription.title}; {prescription.source}"
        )


def _prescription(
    lens: str | None, f_number: float | None, focus_mm: float | None
) -> "Prescription":
    from data_synth.prescription import prescription_names

    if lens is None:
        raise typer.BadParameter(f"name a lens: {', '.join(prescription_names())}")
    return settable_prescription("LENS", lens, f_number, "--focus", focus_mm)


def _frame(size: str, prescription: "Prescription") -> "Frame":
    """The sensor that the lens is made for, as high as the picture's shape asks."""
    from data_synth.wavefront_cases import frame_for

    return frame_for(prescription, photograph_size_px(size))


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


class _ChartsUnlessNamed(TyperGroup):
    """`lensfit synth LENS` photographs charts, as `lensfit synth charts LENS` does."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command's name before the name of a lens or an option."""
        if not args or args[0] not in {*self.commands, *ctx.help_option_names}:
            args = ["charts", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_ChartsUnlessNamed,
    help="""Photograph charts or a scene through a published lens, by exact ray tracing.

    `lensfit synth LENS` photographs charts; see `lensfit synth charts --help`.

    Example: lensfit synth nikkor_28 --out shoot --size 1280x960 --f-number 5.6
    """,
)
app.command()(charts)
app.command()(scene)

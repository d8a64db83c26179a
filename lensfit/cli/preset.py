"""`lensfit preset`: what a preset holds, whether it is sound, and an ideal one."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.errors import LensfitError

if TYPE_CHECKING:
    from rich.table import Table

    from lensfit.preset.entry import Entry
    from lensfit.preset.schema import Preset

app = typer.Typer(
    no_args_is_help=True, help="Look into a preset, check it, or make an ideal one."
)

PresetFile = Annotated[Path, typer.Argument(help="preset.json")]
AsJson = Annotated[bool, typer.Option("--json", help="Print as JSON")]


@app.command()
def show(preset: PresetFile, as_json: AsJson = False) -> None:
    """Print which lens a preset holds, its entries and how good each is.

    Example: lensfit preset show takumar_50/preset.json
    """
    from lensfit.preset.store import load_preset, preset_tables

    loaded = load_preset(preset)
    if as_json:
        typer.echo(json.dumps(preset_tables(loaded)))
        return
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    for line in _heading(loaded):
        console.print(line, markup=False)
    console.print(_entries(loaded.entries))


@app.command()
def validate(
    presets: Annotated[list[Path], typer.Argument(help="preset.json files")],
    as_json: AsJson = False,
) -> None:
    """Check presets against the schema; every fault is one line with its key.

    Example: lensfit preset validate presets/*.json
    """
    from lensfit.cli._door import say_error
    from lensfit.preset.store import load_preset

    faults: dict[str, str | None] = {}
    for path in presets:
        try:
            load_preset(path)
            faults[str(path)] = None
        except LensfitError as error:
            faults[str(path)] = str(error)
    if as_json:
        typer.echo(json.dumps(faults))
    for path, fault in faults.items():
        if fault is not None:
            say_error(fault)
        elif not as_json:
            typer.echo(f"{path}: valid")
    if any(faults.values()):
        raise typer.Exit(1)


@app.command("thin-lens")
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
    typer.echo(f"{out}: thin lens {stated.focal_length_mm:g} mm f/{stated.f_number:g}")


def _heading(preset: "Preset") -> list[str]:
    camera, made = preset.camera, preset.provenance
    serial = f", serial {preset.lens.serial}" if preset.lens.serial else ""
    return [
        f"{preset.lens.name}{serial}",
        f"{camera.model or 'camera'}: {camera.sensor_width_mm:g} x "
        f"{camera.sensor_height_mm:g} mm, {camera.image_width_px} x "
        f"{camera.image_height_px} px",
        f"made {made.created} by lensfit {made.lensfit_version} from "
        f"{len(made.images)} photographs",
        "",
    ]


def _entries(entries: "tuple[Entry, ...]") -> "Table":
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("entry")
    columns = ("principal distance", "lateral colour", "fall-off", "blur", "terms")
    for name in (*columns, "held out"):
        table.add_column(name, justify="right")
    for entry in entries:
        quality = entry.quality
        held_out = quality.held_out_rms_px
        stops = [f.f_number for f in entry.fall_off if not f.predicted]
        table.add_row(
            str(entry),
            f"{entry.projection.principal_distance_mm:.4f} mm",
            "yes" if entry.lateral_colour else "no",
            " ".join("f/?" if n is None else f"f/{n:g}" for n in stops) or "no",
            _blur(entry),
            str(sum(term.kept for term in entry.terms)),
            "-" if held_out is None else f"{held_out:.3f} px",
        )
    return table


def _blur(entry: "Entry") -> str:
    if entry.blur is None:
        return "no"
    stops = " ".join(f"f/{stop.f_number:g}" for stop in entry.blur.stops)
    return f"{len(entry.blur.aberrations)} terms {stops}".rstrip()

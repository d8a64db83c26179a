"""`lensfit preset show`, `diff`, `validate`: what presets hold, and their faults."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from lensfit.cli._terminal import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup
from lensfit.printable import printable

if TYPE_CHECKING:
    from rich.table import Table

    from lensfit.preset.entry import Entry
    from lensfit.preset.library.diff import Difference
    from lensfit.preset.library.layers import FoundPreset
    from lensfit.preset.schema import Preset


@takes_groups
def show(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    library: LibraryGroup,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print which lens a preset holds, its entries and how good each is.

    Of a library, also the versions it was put together from, and which level decided
    each key that was changed.

    Example: lensfit preset show takumar_50/preset.json
    """
    from lensfit.preset.store import preset_tables

    found = library.find(preset)
    if as_json:
        typer.echo(json.dumps(preset_tables(found.preset)))
        return
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    for line in _heading(found.preset):
        console.print(printable(line), markup=False)
    console.print(_entries(found.preset.entries))
    for line in _origins(found):
        console.print(printable(line), markup=False)


def _origins(found: "FoundPreset") -> list[str]:
    """The versions, and each changed key with the level that decided it."""
    from lensfit.preset.knobs import active_knobs

    lines = [f"{p.level} {p.version}: {p.path}" for p in found.parts]
    changed = [f"changed: {override}" for override in found.overrides]
    if not changed and found.preset.saved is not None:
        changed = [f"changed: {edit}" for edit in found.preset.saved.edits]
    knobs = [f"knob: {n} = {v}" for n, v in active_knobs(found.preset.knobs).items()]
    lines += changed + knobs
    return ["", *lines] if lines else []


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
            printable(str(entry)),
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


@takes_groups
def diff(
    a: Annotated[str, typer.Argument(help=PRESET_HELP)],
    b: Annotated[str, typer.Argument(help=PRESET_HELP)],
    library: LibraryGroup,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print every key at which two presets differ.

    Numbers with their relative change, measured ones also in standard deviations where
    a preset states them. The same version of two levels: project:zeiss-50@v001 and
    sq010:zeiss-50@v001.

    Example: lensfit preset diff zeiss-50@v001 zeiss-50@v002 --library show
    """
    from lensfit.preset.library.diff import differences

    one, other = library.find(a), library.find(b)
    found = differences(one.preset, other.preset)
    if as_json:
        typer.echo(json.dumps([_plain(each) for each in found]))
        return
    say_line(f"{one.full_name} -> {other.full_name}")
    if not found:
        say_line("no difference")
    for difference in found:
        say_line(_line(difference))


def _plain(one: "Difference") -> dict[str, object]:
    """As JSON has it; a value that is not there is left out."""
    from lensfit.preset.library.key_path import MISSING

    return {k: v for k, v in one._asdict().items() if v is not MISSING}


def _line(one: "Difference") -> str:
    from lensfit.preset.library.layers import value_text

    said = [f"{100 * one.relative:+.3g} %"] if one.relative is not None else []
    if one.deviations is not None:
        said.append(f"{one.deviations:+.2g} standard deviations")
    more = f" ({', '.join(said)})" if said else ""
    return f"{one.key}: {value_text(one.a)} -> {value_text(one.b)}{more}"


def validate(
    presets: Annotated[
        list[Path],
        typer.Argument(help="Presets, change sets, folders of lenses or libraries"),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Check presets against the schema; every fault is one line with its key.

    Of a library, every version at the named level and those around it is put together
    and checked.

    Example: lensfit preset validate presets/*.json
    """
    from lensfit.cli._door import say_error
    from lensfit.errors import LensfitError
    from lensfit.preset.library.catalogue import validation_faults

    faults: dict[str, str | None] = {}
    for path in presets:
        try:
            faults |= validation_faults(path)
        except LensfitError as error:
            faults[str(path)] = str(error)
    if as_json:
        typer.echo(json.dumps(faults))
    for name, fault in faults.items():
        if fault is None and not as_json:
            say_line(f"{name}: valid")
    # Edits of a bad version are bad for the same reason, which is said once.
    for fault in dict.fromkeys(filter(None, faults.values())):
        say_error(fault)
    if any(faults.values()):
        raise typer.Exit(1)

"""``lensfit inspect``: what pictures say of themselves, and a draft shoot file."""

from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._terminal import console
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.camera import CameraGroup
from lensfit.cli.groups.library import LibraryGroup


@takes_groups
def inspect(
    images: Annotated[
        list[Path],
        typer.Argument(help="Pictures, or a frame pattern such as plate.####.exr."),
    ],
    *,
    preset: Annotated[
        str | None,
        typer.Option(help="Also say what this preset needs, and what is taken from it"),
    ] = None,
    library: LibraryGroup,
    camera: CameraGroup,
    write_shoot: Annotated[
        Path | None, typer.Option(help="Draft a shoot file from what the headers know.")
    ] = None,
    slates: Annotated[
        list[Path] | None,
        typer.Option(
            help="Camera report (CSV, ALE) by which the draft is filled in, repeatable"
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print machine-readable results.")
    ] = False,
) -> None:
    """Show size, encoding, windows, camera state and clipping of pictures.

    Shows the source of every camera value and of every adjusted knob, with the values
    of other sources (or of other entries of the same header).
    A drafted shoot file has the targets that charts made by `lensfit chart` state.

    Example: lensfit inspect dots_*.jpg --write-shoot shoot.toml
    Example: lensfit inspect plate.1001.exr --metadata A001.csv --camera shot.nk
    Example: lensfit inspect plate.1001.exr --preset takumar_50/preset.json
    """
    from lensfit.cli._door import say_error, say_note
    from lensfit.cli._terminal import progress_bars
    from lensfit.io.camera.slates import read_slates, slate_of
    from lensfit.plate.camera.sources import CameraSources
    from lensfit.plate.notes import notes_of_new_topics
    from lensfit.workflow.inspect import as_json, inspect_images
    from lensfit.workflow.shoot.draft import write_draft_shoot

    sources = CameraSources(camera.sources(), camera.overrides())
    with progress_bars() as progress:
        inspections, errors = inspect_images(
            images,
            progress,
            sources,
            charts=write_shoot is not None,
            preset=None if preset is None else library.find(preset).preset,
        )
    if json:
        _print_json([as_json(inspection) for inspection in inspections])
    else:
        for inspection in inspections:
            _print_table(inspection)
    for note in notes_of_new_topics(
        (n for found in inspections for n in found.camera.notes), ()
    ):
        say_note(note)
    failures = [f"{i.path}: {said}" for i in inspections for said in i.camera.problems]
    failures += map(str, errors)
    for failure in failures:
        say_error(failure)
    if write_shoot is not None and inspections:
        reports = {path: read_slates(path) for path in slates or []}
        for path, rows in reports.items():
            if not any(slate_of(rows, i.path, i.exposed_at) for i in inspections):
                say_note(f"{path}: none of its rows is of these photographs")
        write_draft_shoot(write_shoot, inspections, list(chain(*reports.values())))
        say_note(f"{write_shoot}: drafted; fill in the lines marked TODO")
    if failures:
        raise typer.Exit(1)


def _print_json(records: list[dict[str, object]]) -> None:
    import json

    typer.echo(json.dumps(records, indent=1))


def _print_table(inspection) -> None:
    from rich.table import Table
    from rich.text import Text

    from lensfit.printable import printable
    from lensfit.workflow.inspect import facts

    title = Text(printable(str(inspection.path)))
    table = Table(title=title, title_justify="left", show_header=False)
    lines = facts(inspection)
    columns = 3 if any(source for *_, source in lines) else 2
    for _ in range(columns):
        table.add_column(overflow="fold")  # the end of a path says which file it is
    for line in lines:
        table.add_row(*(Text(printable(cell)) for cell in line[:columns]))
    console().print(table)

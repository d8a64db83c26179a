"""``lensfit inspect``: what pictures say of themselves, and a draft shoot file."""

from pathlib import Path
from typing import Annotated

import typer


def inspect(
    images: Annotated[
        list[Path],
        typer.Argument(help="Pictures, or a frame pattern such as plate.####.exr."),
    ],
    write_shoot: Annotated[
        Path | None,
        typer.Option(help="Draft a shoot file from what the headers know."),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print machine-readable results.")
    ] = False,
) -> None:
    """Show size, encoding, windows, camera state and clipping of pictures.

    Example: lensfit inspect dots_*.jpg --write-shoot shoot.toml
    """
    from lensfit.cli._bars import progress_bars
    from lensfit.cli._door import say_error, say_note
    from lensfit.workflow.draft_shoot import write_draft_shoot
    from lensfit.workflow.inspect import as_json, inspect_images

    with progress_bars() as progress:
        inspections, errors = inspect_images(images, progress)
    if json:
        _print_json([as_json(inspection) for inspection in inspections])
    else:
        for inspection in inspections:
            _print_table(inspection)
    for error in errors:
        say_error(str(error))
    if write_shoot is not None and inspections:
        write_draft_shoot(write_shoot, inspections)
        say_note(f"{write_shoot}: drafted; fill in the lines marked TODO")
    if errors:
        raise typer.Exit(1)


def _print_json(records: list[dict[str, object]]) -> None:
    import json

    typer.echo(json.dumps(records, indent=1))


def _print_table(inspection) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from lensfit.workflow.inspect import facts

    table = Table(title=str(inspection.path), title_justify="left", show_header=False)
    for line in facts(inspection):
        table.add_row(*(Text(cell) for cell in line))
    Console().print(table)

"""`lensfit preset list`: the lenses of a library, level by level."""

import json
from typing import Annotated

import typer

from lensfit.cli._console import console, say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import LibraryGroup
from lensfit.printable import printable


@takes_groups
def list_lenses(
    library: LibraryGroup,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print the lenses of a library with their versions, nearest level first.

    Example: lensfit preset list --library show/sq010
    """
    from lensfit.preset.library.catalogue import catalogue

    levels = library.levels()
    rows = catalogue(levels)
    if as_json:
        typer.echo(json.dumps([row._asdict() for row in rows]))
        return
    if not rows:
        say_line(f"{levels[0].lenses}: no lens yet")
        return
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, header_style="bold")
    # What has to be typed elsewhere is whole.
    for name in ("lens", "level"):
        table.add_column(name, no_wrap=True)
    for name in ("versions", "in use", "default", ""):
        table.add_column(name, overflow="fold")
    for row in rows:
        span = " to ".join(dict.fromkeys(row.versions[:1] + row.versions[-1:]))
        what = row.fault or (row.lens or "") + (
            ", change set" if row.change_set else ""
        )
        cells = (row.slug, row.level, span, row.in_use or "-", row.marked or "-", what)
        table.add_row(*(Text(printable(cell)) for cell in cells))
    console().print(table)

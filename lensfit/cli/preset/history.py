"""`lensfit preset history`: every version of a lens, who made it, when and why."""

import json
from typing import Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import LibraryGroup


@takes_groups
def history(
    lens: Annotated[str, typer.Argument(help="NAME of the library")],
    library: LibraryGroup,
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON")] = False,
) -> None:
    """Print every version of a lens at every level: who made it, when and why.

    A star marks the version of each level that is in use.

    Example: lensfit preset history zeiss-50 --library show/sq010/sh0020
    """
    from lensfit.preset.library.history import history as events_of
    from lensfit.preset.library.resolve_preset import lens_in
    from lensfit.preset.library.shelf import shelves_of

    levels = library.levels()
    events = events_of(shelves_of(levels, lens_in(levels, lens.partition("@")[0])))
    if as_json:
        typer.echo(json.dumps([event._asdict() for event in events]))
        return
    for event in events:
        star = "*" if event.in_use else " "
        by = f" by {event.who}" if event.who else ""
        said = f"{star} {event.level} {event.version}  {event.when}{by}"
        for line in (said, *(f"    {what}" for what in event.what)):
            say_line(line)

"""`lensfit preset save`: a preset as the next version of its lens."""

import json
from typing import Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import LibraryGroup, user_name


@takes_groups
def save(
    preset: Annotated[str, typer.Argument(help="preset.json")],
    library: LibraryGroup,
    default: Annotated[
        bool,
        typer.Option("--default", help="Use this version when none is named"),
    ] = False,
    note: Annotated[str, typer.Option(help="What it is, for the record")] = "",
    who: Annotated[str | None, typer.Option(help="Who saves it")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Say it as JSON")] = False,
) -> None:
    """Save a preset as the next version of its lens; nothing is ever overwritten.

    The lens' folder is named after the lens and its serial number. Without --library
    (or LENSFIT_LIBRARY) the user's own library is used.

    Example: lensfit preset save takumar_50/preset.json --library show --default
    """
    from lensfit.cli._door import say_note
    from lensfit.preset.library.levels import levels_of, library_folder
    from lensfit.preset.library.names import version_name
    from lensfit.preset.library.save import keep_preset
    from lensfit.preset.library.shelf import Shelf

    found = library.find(preset)
    if library.library is None:
        library_folder().mkdir(parents=True, exist_ok=True)
    level = levels_of(library.library)[0]
    kept = keep_preset(
        found.taken_out(user_name(who)) if found.parts else found.preset,
        level,
        who=user_name(who),
        note=note,
        default=default,
    )
    if as_json:
        said = {"path": str(kept.path), "lens": kept.slug}
        typer.echo(json.dumps(said | {"version": version_name(kept.number)}))
    else:
        say_line(kept.path)
    in_use = Shelf(level, kept.slug).in_use()
    if in_use != kept.number:
        say_note(
            f"{version_name(in_use)} is in use when no version is named; mark the new "
            f"one with: lensfit preset default {kept.slug}@{version_name(kept.number)}"
        )

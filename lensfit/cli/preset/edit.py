"""`lensfit preset edit`: change keys at one level, on record."""

from typing import Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import LibraryGroup, user_name


@takes_groups
def edit(
    lens: Annotated[str, typer.Argument(help="NAME or NAME@v002 of the library")],
    library: LibraryGroup,
    why: Annotated[str, typer.Option(help="Reason, for the record")],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="KEY=VALUE; repeat for more", metavar="KEY=VALUE"),
    ] = None,
    drop: Annotated[
        list[str] | None,
        typer.Option(help="KEY to give back to the preset beneath", metavar="KEY"),
    ] = None,
    who: Annotated[str | None, typer.Option(help="Who edits")] = None,
    unlock: Annotated[
        bool, typer.Option("--unlock", help="Change measured values too")
    ] = False,
    pin: Annotated[
        bool,
        typer.Option(
            "--pin", help="Stand on the outer version now in use, whatever comes later"
        ),
    ] = False,
) -> None:
    """Change keys of a lens at the level of --library; who, when and why are recorded.

    A new version is made; the level holds only what differs from the levels around it.
    Keys are names joined by dots, members of lists by what they are, or the name of a
    knob. Measured values are locked.

    Example: lensfit preset edit zeiss-50 --library show/sq010 --set coma_gain=0.5
    --why "too strong on faces"
    """
    from lensfit.cli._door import say_note
    from lensfit.preset.library.edit import (
        Author,
        RequestedEdit,
        edit_preset,
        requested_edit_of_text,
    )

    wishes = [requested_edit_of_text(text) for text in settings or ()]
    wishes += [RequestedEdit(key, drop=True) for key in drop or ()]
    found = edit_preset(
        lens,
        wishes,
        Author(user_name(who), why),
        library=library.library,
        unlock=unlock,
        pin=pin,
    )
    for note in found.notes:
        say_note(note)
    say_line(found.path)
    for override in found.overrides:
        if override.part == found.parts[0]:
            say_line(str(override))

"""`lensfit preset project`: mark the folder where a library's levels end."""

from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.groups.library import user_name


def project(
    folder: Annotated[Path, typer.Argument(help="Folder of the whole project")],
    who: Annotated[str | None, typer.Option(help="Who marks it")] = None,
) -> None:
    """Mark a folder as a project: folders below are its sequences and shots.

    A preset that is looked up in a shot is then also found in its sequence and in the
    project, and the nearest level wins, key by key.

    Example: lensfit preset project show
    """
    from lensfit.preset.library.levels import mark_project

    new = mark_project(folder, user_name(who))
    say_line(f"{folder}: {'is a project now' if new else 'was a project already'}")

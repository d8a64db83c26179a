"""`lensfit preset load`: a preset of a library as a file of its own."""

from pathlib import Path
from typing import Annotated

import typer

from lensfit.cli._console import say_line
from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup, user_name


@takes_groups
def load(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    library: LibraryGroup,
    out: Annotated[Path, typer.Option("--out", help="Preset to write")],
    who: Annotated[str | None, typer.Option(help="Who takes it out")] = None,
) -> None:
    """Write a preset of a library, with all edits in it, to a file.

    The file records the versions and edits it was put together from.

    Example: lensfit preset load zeiss-50@v002 --library show/sq010 --out zeiss.json
    """
    from lensfit.preset.store import save_preset

    found = library.find(preset)
    save_preset(found.taken_out(user_name(who)), out)
    say_line(f"{out}: {found.full_name}, {found.preset.lens.name}")

"""`lensfit preset default`: mark the version that is used when none is named."""

from typing import Annotated

import typer

from lensfit.cli.groups import takes_groups
from lensfit.cli.groups.library import LibraryGroup, user_name


@takes_groups
def default(
    lens: Annotated[str, typer.Argument(help="NAME@v002 of the library")],
    library: LibraryGroup,
    who: Annotated[str | None, typer.Option(help="Who marks it")] = None,
) -> None:
    """Mark a version as the one that is used when none is named.

    Later edits of the marked version are used too; mark it again to go back.

    Example: lensfit preset default zeiss-50@v001 --library show
    """
    from lensfit.errors import PresetError
    from lensfit.preset.library.names import version_name
    from lensfit.preset.library.resolve_preset import lens_in
    from lensfit.preset.library.save import mark_default
    from lensfit.preset.library.shelf import Shelf

    name, _, requested = lens.partition("@")
    levels = library.levels()
    shelf = Shelf(levels[0], lens_in(levels, name))
    if not shelf.numbers:
        raise PresetError("holds no version", where=shelf.folder)
    if not requested:
        raise PresetError(f"say which version: {shelf.slug}@v001")
    number = shelf.number(requested)
    mark_default(shelf, number, user_name(who))
    typer.echo(f"{shelf.slug}: {version_name(number)} is used when none is named")

"""`lensfit view`: a lens in a page of the browser, while it is turned."""

import importlib
from pathlib import Path
from typing import Annotated, Any

import typer

from lensfit.cli.apply import OutputName, apply, apply_options
from lensfit.cli.groups import in_groups, takes_groups
from lensfit.cli.groups.handed_on import hands_on
from lensfit.cli.groups.library import PRESET_HELP, LibraryGroup
from lensfit.workflow.farm.job import HandedOption

_NOT_SEEN = (
    "preset", "plates", "out", "frames", "workers", "library", "output", "disable",
    "overwrite", "keep", "as_json", "progress_as",
)  # fmt: skip


@hands_on(apply, except_for=_NOT_SEEN, files=("filter_image",))
@takes_groups
def view(
    preset: Annotated[str, typer.Argument(help=PRESET_HELP)],
    plates: Annotated[
        str | None,
        typer.Argument(help="EXR plate with depth, or plate.####.exr for a sequence"),
    ] = None,
    *,
    library: LibraryGroup,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Of the address; 0 is any free one")
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page")
    ] = True,
    handed: tuple[HandedOption, ...],
    taken: dict[str, Any],
) -> None:
    """Look at a plate through a lens in the browser, and turn it.

    The page is served by this process to this machine alone, under an address that
    nobody else knows, and ends with it (Ctrl-C). Click to focus; what was turned is
    saved as the command line of apply that does the same, or to the shot's
    lensfit.toml. Takes the options of apply.

    Example: lensfit view takumar/preset.json plate.1001.exr
    """
    if plates is None or _is_of_a_shoot(preset):
        raise _nothing_to_view(preset)
    from lensfit.cores import limit_cores

    if taken["cores"] is not None:
        limit_cores(taken["cores"])
    server = _import_server()
    from lensfit.workflow.view.turned import Started
    from lensfit.workflow.view.viewed_plate import ViewedPlate

    given = dict(taken, output=OutputName.result, overwrite=False, keep=False)
    options = apply_options(**in_groups(apply, given))
    viewed = ViewedPlate(library.find(preset).preset, plates, options)
    words = tuple((one.word, *map(str, one.values)) for one in handed)
    if library.library is not None:
        words += (("--library", str(library.library)),)
    answers = server.PlateServer(viewed, Started(preset, plates, words))
    page = server.listening(answers.routes, port)
    _open(page.address, browser)
    try:
        page.run()
    except KeyboardInterrupt as end:  # the way a view ends
        raise typer.Exit(0) from end


def _is_of_a_shoot(preset: str) -> bool:
    return preset.endswith(".toml") or Path(preset).is_dir()


def _nothing_to_view(preset: str) -> Exception:
    from lensfit.errors import LensfitError

    if not _is_of_a_shoot(preset):
        return LensfitError(
            "there is no plate to look at through the lens",
            where=preset,
            remedy="name an EXR plate after the preset",
        )
    return LensfitError(
        "a view of shoots and of results is not offered",
        where=preset,
        remedy='give a preset and a plate; "lensfit check" and "lensfit report" show '
        "shoots and results",
    )


def _import_server() -> Any:
    from lensfit.errors import LensfitError

    try:
        return importlib.import_module("lensfit.workflow.view.server")
    except ModuleNotFoundError as error:
        raise LensfitError(
            f"the view needs {error.name}, which is not installed",
            remedy="pip install 'lensfit[view]'",
        ) from error


def _open(address: str, browser: bool) -> None:
    """Say where the page is; show it, if wanted."""
    typer.echo(address)
    if browser:
        import webbrowser

        webbrowser.open(address)

"""`lensfit view`: a lens, a plate or a shoot in a page of the browser."""

import importlib
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lensfit.cli.apply import OutputName, apply, apply_options
from lensfit.cli.groups import options_in_groups, takes_groups
from lensfit.cli.groups.forwarded_options import hands_on
from lensfit.cli.groups.library import LibraryGroup
from lensfit.plate.farm.job import HandedOption

if TYPE_CHECKING:
    from lensfit.plate.apply_options import ApplyOptions
    from lensfit.workflow.view.lens_server import LensServer
    from lensfit.workflow.view.plate_server import PlateServer
    from lensfit.workflow.view.shoot_server import ShootServer

_NOT_SEEN = (
    "preset", "plates", "out", "frames", "workers", "library", "output", "disable",
    "overwrite", "keep", "as_json", "progress_as",
)  # fmt: skip


@hands_on(apply, except_for=_NOT_SEEN, files=("filter_image",))
@takes_groups
def view(
    what: Annotated[
        str | None,
        typer.Argument(
            help="Preset (a file, or a lens of the library by its name), folder of "
            "results, or shoot file; a new shoot in this folder if left out"
        ),
    ] = None,
    plates: Annotated[
        str | None,
        typer.Argument(
            help="EXR plate with depth to see through the preset, or plate.####.exr"
        ),
    ] = None,
    *,
    beside: Annotated[
        str | None,
        typer.Option(help="Another preset, to be seen side by side with the first"),
    ] = None,
    images: Annotated[
        Path | None,
        typer.Option(help="Folder of a shoot's photographs; else the shoot file's own"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for a shoot's results; else beside it"),
    ] = None,
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
    """Look in the browser at a lens on a plate, at a lens by itself, or at a shoot.

    With a plate: the frame through the lens; click to focus; adjustments are saved
    as the command line of apply that does the same, or to the shot's lensfit.toml.
    Without: point-spread functions, distortion, colour, fall-off and breathing, with
    standard deviations; of a folder of results also its dots and its report.
    Of a shoot: photographs, checked as they arrive; its file as a form; a calibration.

    The page is served by this process to this machine alone, under a secret
    address, and ends with it (Ctrl-C). Takes the options of apply.

    Example: lensfit view takumar/preset.json plate.1001.exr
    Example: lensfit view takumar/preset.json --beside zeiss/preset.json
    Example: lensfit view shoot.toml --out takumar
    """
    _require_preset_first(what)
    if taken["cores"] is not None:
        from lensfit.cores import limit_cores

        limit_cores(taken["cores"])
    given = dict(taken, output=OutputName.result, overwrite=False, keep=False)
    options = apply_options(**options_in_groups(apply, given))
    loopback_server = _part("loopback_server").loopback_server
    if what is None or what.endswith(".toml"):
        server = _shoot_server(Path(what or "shoot.toml"), images, out)
    elif plates is None:
        server = _lens_server(what, beside, library, options)
    else:
        server = _plate_server(what, plates, library, options, handed)
    try:
        page = loopback_server(server.routes, port, server.uploads)
        server.begin()
        _open(page.address, browser)
        page.run()
    except KeyboardInterrupt as end:  # the way a view ends
        raise typer.Exit(0) from end
    finally:
        server.end()


def _require_preset_first(what: str | None) -> None:
    """Say what comes first where a plate stands there.

    Raises
    ------
    LensfitError : It is a plate.
    """
    if what is not None and what.lower().endswith(".exr"):
        from lensfit.errors import LensfitError

        raise LensfitError(
            "is a plate, and a preset comes before it",
            where=what,
            remedy=f"lensfit view PRESET {shlex.quote(what)}",
        )


def _plate_server(
    preset: str,
    plates: str,
    library: LibraryGroup,
    options: "ApplyOptions",
    handed: tuple[HandedOption, ...],
) -> "PlateServer":
    server = _part("plate_server")
    from lensfit.workflow.view.lens_adjustments import LibraryLens, StartCommand
    from lensfit.workflow.view.viewed_plate import ViewedPlate

    found = library.find(preset)
    viewed = ViewedPlate(found.preset, plates, options)
    shelved = None
    if found.parts:
        shelved = LibraryLens(found.name.partition("@")[0], library.library)
    words = tuple((one.word, *map(str, one.values)) for one in handed)
    if library.library is not None:
        words += (("--library", str(library.library)),)
    return server.PlateServer(viewed, StartCommand(preset, plates, words), shelved)


def _shoot_server(shoot: Path, images: Path | None, out: Path | None) -> "ShootServer":
    server = _part("shoot_server")
    from lensfit.workflow.view.viewed_shoot import ViewedShoot

    results = out or shoot.with_name(f"{shoot.stem}_results")
    return server.ShootServer(ViewedShoot(shoot, images, results))


def _lens_server(
    what: str, beside: str | None, library: LibraryGroup, options: "ApplyOptions"
) -> "LensServer":
    server = _part("lens_server")
    from lensfit.workflow.view.lens_adjustments import adjustments_of_options
    from lensfit.workflow.view.viewed_lens import ViewedLens
    from lensfit.workflow.view.viewed_results import ViewedResults

    results = ViewedResults(Path(what)) if Path(what).is_dir() else None
    first = what if results is None else str(results.preset)
    lenses = [
        ViewedLens(
            library.find(name).preset,
            name,
            adjustments_of_options(options),
            sensor_width_mm=options.overrides.sensor_width_mm,
            scale_to_sensor=options.scale_to_sensor,
        )
        for name in (first, beside)
        if name is not None
    ]
    return server.LensServer(lenses, results)


def _part(name: str) -> Any:
    """A module of the view that needs the extra.

    Raises
    ------
    LensfitError : The extra is not installed.
    """
    from lensfit.errors import LensfitError

    try:
        return importlib.import_module(f"lensfit.workflow.view.{name}")
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

"""The command line: parses, calls `lensfit.workflow`, prints.

Each command is a file of its own beside this one (those of `preset` have a room) and
imports what it needs inside its function, so that ``lensfit --help`` is instant.
"""

import importlib
from importlib.util import find_spec
from typing import Annotated

import typer

from lensfit import __version__
from lensfit.cli._door import DoorGroup, interruptible

COMMANDS = (
    "demo",
    "chart",
    "inspect",
    "check",
    "calibrate",
    "kit",
    "report",
    "stmap",
    "overscan",
    "export",
    "apply",
    "view",
    "undistort",
    "submit",
    "plan",
    "preset",
)
MEASURING = ("synth", "bench")
"""Commands of `data_synth`, where it is installed."""

app = typer.Typer(
    name="lensfit",
    cls=DoorGroup,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Calibrate cinema lenses from photographs of grids; put them on CG plates.",
    epilog="Try: lensfit demo --out demo",
)


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"lensfit {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_say_version, is_eager=True, help="Say the version"
        ),
    ] = False,
    debug: Annotated[
        bool,
        typer.Option("--debug", help="Show the whole traceback when something fails"),
    ] = False,
) -> None:
    pass


def _doors() -> list[str]:
    doors = [f"lensfit.cli.{name}" for name in COMMANDS]
    if find_spec("data_synth") is not None:
        doors += [f"data_synth.commands.{name}" for name in MEASURING]
    return doors


def _register() -> None:
    for door in _doors():
        module = importlib.import_module(door)
        name = door.rpartition(".")[2]
        if hasattr(module, "app"):
            app.add_typer(module.app, name=name)
        else:
            app.command(name)(getattr(module, name))


_register()


def main() -> None:
    """Run the command line."""
    with interruptible():
        app()

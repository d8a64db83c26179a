"""Standard output: where tables are printed, and lines that hold names of others."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lensfit.printable import printable

if TYPE_CHECKING:
    from rich.console import Console

_WIDTH = 150


def console() -> "Console":
    """Standard output, as wide as the terminal; a log is not cut at 80 characters."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else _WIDTH
    return Console(highlight=False, width=width)


def say_line(line: str | Path) -> None:
    """Print one line: a result, or the path of one, as a terminal can show it."""
    typer.echo(printable(str(line)))

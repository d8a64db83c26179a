"""What a command prints on the terminal: results, and how far it is.

Results and their tables go to standard output. Progress goes to standard error: bars,
which vanish where that is no terminal, or for logs and farms one line for each finished
frame, with its number of all and what became of it. The workers of Open Job Description
read the share that is done from a line of its own, ``openjd_progress: 42.0`` (percent).

References
----------
Open Job Description, "How Jobs Are Run", messages of an action.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from lensfit.printable import printable
from lensfit.progress import Progress, silent

if TYPE_CHECKING:
    from rich.console import Console

    from lensfit.plate.frame.frame_outcome import FrameOutcome
    from lensfit.workflow.apply import FrameDone

_LOG_WIDTH = 150


def console() -> "Console":
    """Standard output, as wide as the terminal; a log is not cut at 80 characters."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else _LOG_WIDTH
    return Console(highlight=False, width=width)


def say_line(line: str | Path) -> None:
    """Print one line: a result, or the path of one, as a terminal can show it."""
    typer.echo(printable(str(line)))


_COUNTED = ("frames",)


@contextmanager
def progress_bars() -> Iterator[Progress]:
    """A `Progress` with a bar and the time left for each stage, cleared at the end."""
    if not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        ProgressColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bars
    from rich.text import Text

    class Rate(ProgressColumn):
        """Steps per second, for stages that are counted in things."""

        def render(self, task: Task) -> Text:
            if not task.speed or task.description not in _COUNTED:
                return Text("")
            return Text(f"{task.speed:.2f} {task.description}/s")

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        Rate(),
    )
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks = {}

        def progress(stage: str, done: int, total: int) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=None)
            bars.update(tasks[stage], completed=done, total=total or None)

        yield progress


@contextmanager
def frame_progress(kind: str) -> "Iterator[tuple[Progress, FrameDone]]":
    """What is called as the work goes on, and after each frame.

    Parameters
    ----------
    kind : bar; lines; openjd, which are lines with shares; none; or auto, which is a
        bar on a terminal and lines elsewhere.
    """
    on_terminal = sys.stderr.isatty()
    if kind == "bar" or (kind == "auto" and on_terminal):
        with progress_bars() as progress:
            yield progress, _no_line
    elif kind == "none":
        yield silent, _no_line
    elif kind == "openjd":
        yield silent, _openjd_lines
    else:
        yield silent, _frame_line


def _no_line(plate: Path, outcome: "FrameOutcome", done: int, total: int) -> None:
    pass


def _frame_line(plate: Path, outcome: "FrameOutcome", done: int, total: int) -> None:
    if total == 1:
        return  # what is said in the end says it all
    what = "finished before" if outcome.skipped else "written"
    if outcome.failure is not None:
        what = "failed"
    typer.echo(
        f"lensfit: frame {done} of {total}: {printable(plate.name)} {what}", err=True
    )


def _openjd_lines(plate: Path, outcome: "FrameOutcome", done: int, total: int) -> None:
    _frame_line(plate, outcome, done, total)
    typer.echo(f"openjd_progress: {100 * done / total:.1f}", err=True)

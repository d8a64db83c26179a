"""How far a sequence is: a bar on a terminal, lines for logs and farms.

Lines go to standard error, one for each finished frame, with its number of all and what
became of it. The workers of Open Job Description read the share that is done from a
line of its own, ``openjd_progress: 42.0`` (percent).

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

from lensfit.cli._bars import progress_bars
from lensfit.printable import printable
from lensfit.progress import Progress, silent

if TYPE_CHECKING:
    from lensfit.plate.frame.frame_outcome import FrameOutcome
    from lensfit.workflow.apply import FrameDone


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
            yield progress, _nothing
    elif kind == "none":
        yield silent, _nothing
    elif kind == "openjd":
        yield silent, _openjd_lines
    else:
        yield silent, _line


def _nothing(plate: Path, outcome: "FrameOutcome", done: int, total: int) -> None:
    pass


def _line(plate: Path, outcome: "FrameOutcome", done: int, total: int) -> None:
    if total == 1:
        return  # what is said in the end says it all
    what = "finished before" if outcome.skipped else "written"
    if outcome.failure is not None:
        what = "failed"
    typer.echo(
        f"lensfit: frame {done} of {total}: {printable(plate.name)} {what}", err=True
    )


def _openjd_lines(plate: Path, outcome: "FrameOutcome", done: int, total: int) -> None:
    _line(plate, outcome, done, total)
    typer.echo(f"openjd_progress: {100 * done / total:.1f}", err=True)

"""Progress bars on standard error, and nothing at all where that is no terminal."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from lensfit.progress import Progress, silent

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

"""Report the progress of long work to its caller, and the seconds that it takes.

The library never prints: whoever calls a long workflow may pass a `Progress`, and the
command line passes one that draws bars on a terminal.

Seconds are those on the wall, and those of all processors together.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Progress(Protocol):
    """Called whenever a stage of the work moves on."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """`done` of `total` steps of `stage` are finished; `total` 0 if unknown."""
        ...


def silent(stage: str, done: int, total: int) -> None:
    """A `Progress` that says nothing."""


@contextmanager
def stopwatch() -> Iterator[dict[str, float]]:
    """Its "seconds" and "cpu_seconds" (of all threads), known once it is over."""
    spent: dict[str, float] = {}
    began, own = time.perf_counter(), time.process_time()
    try:
        yield spent
    finally:
        spent["seconds"] = time.perf_counter() - began
        spent["cpu_seconds"] = time.process_time() - own

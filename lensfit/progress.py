"""Report the progress of long work to its caller.

The library never prints: whoever calls a long workflow may pass a `Progress`, and the
command line passes one that draws bars on a terminal.
"""

from typing import Protocol


class Progress(Protocol):
    """Called whenever a stage of the work moves on."""

    def __call__(self, stage: str, done: int, total: int) -> None:
        """`done` of `total` steps of `stage` are finished; `total` 0 if unknown."""
        ...


def silent(stage: str, done: int, total: int) -> None:
    """A `Progress` that says nothing."""

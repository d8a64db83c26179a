"""Watch a folder for new photographs of a tethered camera."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

from lensfit.errors import ImageError
from lensfit.io.raw import RAW_SUFFIXES

SUFFIXES = frozenset((".exr", ".png", ".tif", ".tiff", ".jpg", ".jpeg")) | RAW_SUFFIXES
POLL_S = 0.3


def new_photographs(
    folder: Path, go_on: Callable[[], bool] = lambda: True, poll_s: float = POLL_S
) -> Iterator[Path]:
    """Photographs of a folder in the order of their arrival, those there first.

    A file is handed on once its size has stayed the same from one look to the next: a
    camera writes for a while. A file that is written again is handed on again.

    Parameters
    ----------
    go_on : Asked before every look; the iteration ends where it is False.
    poll_s : Seconds between looks.

    Raises
    ------
    ImageError : The folder is none, or vanishes.
    """
    before: dict[Path, tuple[int, int]] = {}
    handed_on: dict[Path, tuple[int, int]] = {}
    while go_on():
        now = _states(folder)
        ready = [
            path
            for path, state in now.items()
            if before.get(path) == state and handed_on.get(path) != state and state[0]
        ]
        for path in sorted(ready, key=lambda one: (now[one][1], one.name)):
            handed_on[path] = now[path]
            yield path
        before = now
        time.sleep(poll_s)


def _states(folder: Path) -> dict[Path, tuple[int, int]]:
    """Size and time of change of every photograph."""
    try:
        found = [
            path
            for path in folder.iterdir()
            if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
        ]
    except OSError as error:
        raise ImageError(
            f"cannot be listed ({error.strerror or error})",
            where=folder,
            remedy="give --watch the folder into which the camera's files arrive",
        ) from error
    states = {}
    for path in found:
        try:
            status = path.stat()
        except OSError:
            continue  # gone between the two looks
        states[path] = status.st_size, status.st_mtime_ns
    return states

"""The photographs of a folder: new ones, and the views of a plan that they are.

The plan is a shoot file: each `[[take]]` is a view, named by its image. A photograph is
the view of its own name; else, as cameras number their files themselves, the first view
still missing whose lens settings are those of the photograph's header.

A folder is watched for new photographs of a tethered camera.
"""

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, final

from lensfit.errors import ImageError, ShootError
from lensfit.io.image import RAW_SUFFIXES
from lensfit.io.metadata import CameraState
from lensfit.units import dioptres_from_mm
from lensfit.workflow.check.check_records import Level
from lensfit.workflow.shoot.shoot_records import Shoot, Take

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


def photographs_of_plan(shoot: Shoot) -> list[Path]:
    """The photographs of a plan that are there.

    Raises
    ------
    ShootError : None of them is.
    """
    paths = [shoot.image_path(take) for take in shoot.takes]
    # Unlike that of `Path`, this says no to names that no file can have.
    found = [path for path in paths if os.path.exists(path)]
    if not found:
        raise ShootError(
            f"none of its {len(paths)} photographs is there, {paths[0].name} the first",
            where=shoot.path,
            remedy="correct the names in its [[take]] tables, or photograph them",
        )
    return found


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


ViewState = Literal["done", "again", "missing"]
_STOP_RATIO = 1.09
"""A quarter of a stop."""
_FOCAL_RATIO = 1.03
_FOCUS_DIOPTRES = 0.03


@final
@dataclass(frozen=True)
class PlannedView:
    """A view of the plan and what became of it.

    Attributes
    ----------
    image : As the shoot file has it.
    state : "done", "again" where its photograph should be shot again, or "missing".
    photograph : The file that is this view, if any.
    """

    image: str
    state: ViewState
    photograph: str | None


def view_of_photograph(
    shoot: Shoot, path: Path, header: CameraState | None, taken: Iterable[str]
) -> Take | None:
    """The view that a photograph is.

    Parameters
    ----------
    header : What the photograph's header knows; None where it knows nothing.
    taken : Images of views that other photographs are.
    """
    whole = path.resolve()
    for take in shoot.takes:
        if shoot.image_path(take).resolve() == whole:
            return take
    for take in shoot.takes:
        if Path(take.image).stem == path.stem:
            return take
    if header is None:
        return None
    for take in shoot.takes:
        free = take.image not in set(taken) and not shoot.image_path(take).exists()
        if free and _same_settings(take, header):
            return take
    return None


def planned_views(
    shoot: Shoot, judged: Mapping[str, tuple[Level, Path]]
) -> Sequence[PlannedView]:
    """Every view of the plan.

    Parameters
    ----------
    judged : Level and file of the photographs that are views, by the views' images.
    """
    views = []
    for take in shoot.takes:
        level, photograph = judged.get(take.image, (None, None))
        state: ViewState = "again" if level == "bad" else "done"
        if level is None and not shoot.image_path(take).exists():
            state = "missing"
        name = None if photograph is None else str(photograph)
        views.append(PlannedView(take.image, state, name))
    return views


def _same_settings(take: Take, header: CameraState) -> bool:
    """Whether at least the f-number is known of both, and nothing known differs."""
    if take.f_number is None or header.f_number is None:
        return False
    return (
        _near(take.f_number, header.f_number, _STOP_RATIO)
        and _near(take.focal_length_mm, header.focal_length_mm, _FOCAL_RATIO)
        and _same_focus(take.focus_distance_mm, header.focus_distance_mm)
    )


def _near(one: float | None, other: float | None, ratio: float) -> bool:
    if one is None or other is None:
        return True
    return max(one, other) <= ratio * min(one, other)


def _same_focus(one_mm: float | None, other_mm: float | None) -> bool:
    if one_mm is None or other_mm is None:
        return True
    gap = abs(dioptres_from_mm(one_mm) - dioptres_from_mm(other_mm))
    return gap <= _FOCUS_DIOPTRES

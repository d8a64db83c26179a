"""The views of a plate, each with the camera that its own header states.

Renderers that write one file for both eyes may state the camera in the first part
alone. A view without any camera entry takes those of the first view, which is noted.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from lensfit.errors import LensfitError, error_at_frame
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.io.exr_views import View, joined_views, views_of
from lensfit.io.metadata import camera_words
from lensfit.plate.notes import FrameNote
from lensfit.plate.plate_file import header_entries


class PlateView(NamedTuple):
    """One view of a plate.

    Attributes
    ----------
    view : As the file has it.
    header : Parts whose attributes state its camera.
    note : What was assumed of its camera.
    picked_in : Where the pixel lies that ``--focus-at`` names, if not in this view: the
        eyes of a camera are focused at one distance, that of the first.
    """

    view: View
    header: ExrImage
    note: str | None = None
    picked_in: ExrImage | None = None

    @contextmanager
    def named_errors(self, path: Path) -> Iterator[None]:
        """Errors that name the view, where there are several."""
        try:
            yield
        except LensfitError as error:
            if not self.view.name:
                raise
            what = f"view {self.view.name!r} {error.what}"
            inner = type(error)(what, where=error.where, remedy=error.remedy)
            raise error_at_frame(inner, path) from error


def plate_views(image: ExrImage, path: Path) -> list[PlateView]:
    """The views of a plate, the default one first.

    Parameters
    ----------
    image : The plate, or its header alone.
    path : Its file.

    Raises
    ------
    ImageError : Its names do not tell its eyes apart.
    """
    try:
        first, *others = views_of(image)
    except LensfitError as error:
        raise error_at_frame(error, path) from error
    found = [PlateView(first, first.image)]
    for view in others:
        if camera_words(header_entries(view.image)):
            found.append(PlateView(view, view.image, picked_in=first.image))
            continue
        stated = ExrImage((*view.image.parts, *map(_header, first.image.parts)))
        note = FrameNote(
            f"{path.name}: view {view.name!r} states no camera; that of view "
            f"{first.name!r} is used",
            f"camera of view {view.name}",
        )
        found.append(PlateView(view, stated, note, first.image))
    return found


def other_cameras_note(views: list[PlateView], path: Path) -> str:
    """Whose camera a picture's is taken to be, and what other views state otherwise."""
    first, *others = views
    words = camera_words(header_entries(first.header))
    known = {name: found[0].value for name, found in words.items()}
    differing = []
    for one in others:
        stated = camera_words(header_entries(one.header))
        values = [
            f"{name} {found[0].value} ({found[0].entry})"
            for name, found in stated.items()
            if found[0].value != known.get(name)
        ]
        differing.append(
            f"view {one.view.name!r} states {', '.join(values) or 'the same'}"
        )
    return f"{path.name}: the camera is that of view {first.view.name!r}; " + "; ".join(
        differing
    )


def one_focus_note(views: list[PlateView], path: Path) -> FrameNote:
    """That all views are focused where the first one has the picked pixel."""
    first = views[0].view.name
    return FrameNote(
        f"{path.name}: all views are focused on what view {first!r} has at --focus-at",
        "focus of views",
    )


def joined_plate_views(
    image: ExrImage, views: list[PlateView], made: list[ExrImage]
) -> ExrImage:
    """The views' pictures in one file again, as `joined_views`."""
    if len(views) == 1:
        return made[0]
    return joined_views(image, [one.view for one in views], made)


def _header(part: ExrPart) -> ExrPart:
    return ExrPart({}, part.data_window, part.display_window, part.attributes)

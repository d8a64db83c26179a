"""The views of a plate, each with the camera that its own header states.

Renderers that write one file for both eyes may state the camera in the first part
alone. A view without any camera entry takes those of the first view, which is noted.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from lensfit.errors import LensfitError
from lensfit.io.exr import ExrImage, ExrPart
from lensfit.io.exr_views import View, joined_views, views_of
from lensfit.io.metadata import camera_words
from lensfit.plate.frame.frame_error import error_at_frame
from lensfit.plate.header import header_entries
from lensfit.plate.notes import FrameNote


class PlateView(NamedTuple):
    """One view of a plate.

    Attributes
    ----------
    view : As the file has it.
    header : Parts whose attributes state its camera.
    note : What was assumed of its camera.
    """

    view: View
    header: ExrImage
    note: str | None = None

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
    """
    first, *others = views_of(image)
    found = [PlateView(first, first.image)]
    for view in others:
        if camera_words(header_entries(view.image)):
            found.append(PlateView(view, view.image))
            continue
        stated = ExrImage((*view.image.parts, *map(_header, first.image.parts)))
        note = FrameNote(
            f"{path.name}: view {view.name!r} states no camera; that of view "
            f"{first.name!r} is used",
            f"camera of view {view.name}",
        )
        found.append(PlateView(view, stated, note))
    return found


def joined_plate_views(
    image: ExrImage, views: list[PlateView], made: list[ExrImage]
) -> ExrImage:
    """The views' pictures in one file again, as `joined_views`."""
    if len(views) == 1:
        return made[0]
    return joined_views(image, [one.view for one in views], made)


def _header(part: ExrPart) -> ExrPart:
    return ExrPart({}, part.data_window, part.display_window, part.attributes)

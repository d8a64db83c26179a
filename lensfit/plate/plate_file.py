"""The file of a plate: its header, its colour channels, its views with their cameras.

A layer is colour when it has red, green and blue, or the grey channel Y. Cryptomatte
is not, although its channels are called r, g, b and a: its values are ids and
coverages of ranks (Cryptomatte specification 1.2.0).

A deep plate's header is read as if it were flat.

Renderers that write one file for both eyes may state the camera in the first part
alone. A view without any camera entry takes those of the first view, which is noted.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lensfit.coords import Window, pixels_over_window
from lensfit.errors import LensfitError, error_at_frame
from lensfit.io.exr import ExrImage, ExrPart, colour_channels, layer_names, read_exr
from lensfit.io.exr_deep import is_deep, read_deep
from lensfit.io.exr_views import View, joined_views, views_of
from lensfit.io.metadata import camera_words
from lensfit.plate.notes import FrameNote


def plate_header(path: Path) -> ExrImage:
    """A plate without its pixels; a deep one as if it were flat."""
    if is_deep(path):
        return ExrImage((read_deep(path).flat,))
    return read_exr(path, header_only=True)


def header_entries(image: ExrImage) -> dict[str, object]:
    """The attributes of all parts; where two differ the first part's count."""
    return {k: v for p in reversed(image.parts) for k, v in p.attributes.items()}


_CRYPTOMATTE_NAME = re.compile(r"(?:.*/)?cryptomatte/[^/]+/name")
_ALPHA = ("A", "a", "alpha")
_GREY = ("Y", "y")


class ColourLayer(NamedTuple):
    """A layer to render: exact channel names, red green blue (alpha), or one grey."""

    layer: str
    names: tuple[str, ...]


def colour_layers(
    part: ExrPart, wanted: Sequence[str] | None = None
) -> list[ColourLayer]:
    """The colour layers of a part.

    Parameters
    ----------
    wanted : Only these layers ("" is the unnamed one); all if None.
    """
    found = []
    for layer in layer_names(part):
        if (wanted is not None and layer not in wanted) or is_cryptomatte(part, layer):
            continue
        names = colour_channels(part, layer)
        grey = len(names) == 1 and names[0].rpartition(".")[2] in _GREY
        if len(names) != 3 and not grey:
            continue
        if any(part.channels[name].dtype == np.uint32 for name in names):
            continue
        prefix = f"{layer}." if layer else ""
        alpha = [f"{prefix}{a}" for a in _ALPHA if f"{prefix}{a}" in part.channels]
        found.append(ColourLayer(layer, names if grey else (*names, *alpha[:1])))
    return found


def is_cryptomatte(part: ExrPart, layer: str) -> bool:
    """Whether a layer is of a Cryptomatte that the header declares, preview included.

    In a part named after the Cryptomatte the layer may be without a name.
    """
    declared = [
        str(value)
        for key, value in part.attributes.items()
        if _CRYPTOMATTE_NAME.fullmatch(key)
    ]
    names = (layer, f"{part.name}.{layer}".rstrip("."), part.name if not layer else "")
    return any(
        re.fullmatch(rf"(?:.*\.)?{re.escape(name)}\d*", own)
        for name in declared
        for own in names
    )


def resized_channels(part: ExrPart, window: Window) -> ExrPart:
    """The part over another window: bits are copied, what lies outside it is zero.

    The standard attribute ``originalDataWindow`` remembers the window it had.
    """
    old = part.data_window
    if window == old:
        return part
    channels = {
        name: pixels_over_window(samples, old, window)
        for name, samples in part.channels.items()
    }
    corners = np.asarray(old, np.int32)
    attributes = {
        "originalDataWindow": (corners[:2], corners[2:]),
        **part.attributes,
    }
    return replace(part, channels=channels, data_window=window, attributes=attributes)


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

"""The views of a stereo or other multi-view OpenEXR file, as pictures of their own.

In a part of its own a view is named by the attribute ``view``. Within one part the
attribute ``multiView`` lists the views, the default one first, whose channels have
plain names; those of the others hold the name of their view, before the layer or before
the channel (``right.R``, ``right.depth.Z``, ``depth.right.Z``). A part without a view
belongs to all of them.

Files of two eyes without either attribute are known by their names: parts that are
called left and right (``rgba.left``), or channels of one part that name an eye and have
colours and a depth of their own (``right.R``, ``right.Z``). A layer without a depth may
as well be a light.

References
----------
OpenEXR, "Storing Multi-View Images in OpenEXR Files" and standard attributes.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from lensfit.coords import Window, pixels_over_window
from lensfit.errors import ImageError
from lensfit.io.depth_channel import is_depth_name
from lensfit.io.exr import ExrImage, ExrPart

EYES = ("left", "right")
_COLOURS = ({"r", "g", "b"}, {"red", "green", "blue"}, {"y"})


def eyes_of_parts(parts: Sequence[ExrPart]) -> tuple[str | None, ...]:
    """The eye that each part's name holds as a word; none unless both are there."""
    found = [_eye_in(re.split(r"[._\s-]+", part.name)) for part in parts]
    if not set(EYES) <= {None if eye is None else eye.lower() for eye in found}:
        return (None,) * len(parts)
    return tuple(found)


def eyes_of_channels(names: Sequence[str]) -> list[str]:
    """The eyes of a part as its channels spell them, the one without a name first;
    empty where none has colours and depth of its own.

    Raises
    ------
    ImageError : Both do, and so do channels without a name.
    """
    plain: dict[str | None, list[str]] = {}
    for name in names:
        eye, rest = view_and_rest(name, _is_eye)
        plain.setdefault(eye, []).append(rest)
    named = [eye for eye, own in plain.items() if eye and _is_picture(own)]
    if not named:
        return []
    if len(named) == 1:
        (other,) = (eye for eye in EYES if eye != named[0].lower())
        return [next((e for e in plain if e and e.lower() == other), other), named[0]]
    if _has_colours(plain.get(None, ())):
        raise ImageError(
            f"names the channels of {' and '.join(named)} beside colours of no eye",
            remedy="state its views in the header entry multiView, or write each eye "
            "to a file of its own",
        )
    return sorted(named, key=str.lower)


def view_and_rest(
    channel: str, is_view: Callable[[str], bool]
) -> tuple[str | None, str]:
    """The view that a channel's name holds, before its own name or before its layer,
    and the name without it."""
    words = channel.split(".")
    for place in dict.fromkeys((len(words) - 2, 0)):
        if 0 <= place < len(words) - 1 and is_view(words[place]):
            return words[place], ".".join(words[:place] + words[place + 1 :])
    return None, channel


def _is_eye(word: str) -> bool:
    return word.lower() in EYES


def _eye_in(words: Iterable[str]) -> str | None:
    return next(filter(_is_eye, words), None)


def _is_picture(names: Sequence[str]) -> bool:
    return _has_colours(names) and any(map(is_depth_name, names))


def _has_colours(names: Iterable[str]) -> bool:
    leaves = {name.lower() for name in names}
    return any(colours <= leaves for colours in _COLOURS)


_VIEW, _VIEWS = "view", "multiView"


class _Own(NamedTuple):
    """Part of a file as far as one view has it, and the names of its channels there."""

    index: int
    part: ExrPart
    names: dict[str, str]


@dataclass(frozen=True, eq=False)
class View:
    """One view of a picture.

    Attributes
    ----------
    name : Empty where the picture has a single view.
    image : Its own parts, then those that belong to all views; channels without the
        name of the view.
    own : Its own parts alone, with their place in the file.
    """

    name: str
    image: ExrImage
    own: tuple[_Own, ...] = ()


def views_of(image: ExrImage) -> tuple[View, ...]:
    """The views of a picture in the order of the file, the default one first; one
    without a name where the file knows of none.

    Raises
    ------
    ImageError : Its channels name both eyes beside a third picture without a name.
    """
    found: dict[str, list[_Own]] = {}
    shared: list[ExrPart] = []
    unstated = _without_views(image)
    eyes = eyes_of_parts(image.parts) if unstated else (None,) * len(image.parts)
    for index, (part, eye) in enumerate(zip(image.parts, eyes, strict=True)):
        split = _channels_by_view(index, part)
        if unstated:
            split = _split_by_name(index, part, eye)
        if not split:
            shared.append(part)
        for name, own in split.items():
            found.setdefault(name, []).append(own)
    if len(found) < 2:
        return (View("", image),)
    return tuple(
        View(name, ExrImage((*(o.part for o in own), *shared)), tuple(own))
        for name, own in found.items()
    )


def joined_views(
    image: ExrImage, views: Sequence[View], made: Sequence[ExrImage]
) -> ExrImage:
    """A file like `image` with other pictures for its views.

    Parameters
    ----------
    views : Of `image`.
    made : For each view the parts of its image, changed, in the same order; parts that
        belong to all views are taken from the first.
    """
    parts: list[ExrPart | None] = [None] * len(image.parts)
    for view, changed in zip(views, made, strict=True):
        for own, part in zip(view.own, changed.parts, strict=False):
            renamed = {own.names.get(n, n): s for n, s in part.channels.items()}
            part, before = replace(part, channels=renamed), parts[own.index]
            if before is not None:
                before, part = _on_common_window(before, part)
                both = {**before.channels, **part.channels}
                part = replace(part, channels=both)
            parts[own.index] = part
    shared = iter(made[0].parts[len(views[0].own) :])
    whole = [part if part is not None else next(shared) for part in parts]
    return ExrImage(
        tuple(
            _with_list_of_views(a, b) for a, b in zip(whole, image.parts, strict=True)
        )
    )


def _with_list_of_views(part: ExrPart, like: ExrPart) -> ExrPart:
    """The part with the list of views that the file's own has."""
    if _VIEWS not in like.attributes:
        return part
    attributes = {**part.attributes, _VIEWS: like.attributes[_VIEWS]}
    return replace(part, attributes=attributes)


def _on_common_window(a: ExrPart, b: ExrPart) -> tuple[ExrPart, ExrPart]:
    """Both over the smallest window that holds them."""
    window = a.data_window.joined(b.data_window)
    return _over(a, window), _over(b, window)


def _over(part: ExrPart, window: Window) -> ExrPart:
    channels = {
        name: pixels_over_window(samples, part.data_window, window)
        for name, samples in part.channels.items()
    }
    return replace(part, channels=channels, data_window=window)


def _channels_by_view(index: int, part: ExrPart) -> dict[str, _Own]:
    """The part by view; nothing where it belongs to all of them."""
    name = part.attributes.get(_VIEW)
    if isinstance(name, str) and name:
        return {name: _Own(index, part, {})}
    views = part.attributes.get(_VIEWS)
    if not isinstance(views, list) or len(views) < 2:
        return {}
    return _split_channels(index, part, [str(view) for view in views])


def _split_channels(index: int, part: ExrPart, views: list[str]) -> dict[str, _Own]:
    """A part whose channels name their view, by view."""
    channels: dict[str, dict[str, str]] = {view: {} for view in views}
    for channel in part.channels:
        view, plain = _view_and_name(channel, views)
        channels[view][plain] = channel
    kept = {k: v for k, v in part.attributes.items() if k != _VIEWS}
    return {
        view: _Own(
            index,
            replace(
                part,
                channels={p: part.channels[c] for p, c in names.items()},
                attributes=kept,
            ),
            names,
        )
        for view, names in channels.items()
        if names or not part.channels
    }


def _without_views(image: ExrImage) -> bool:
    """Whether no part states its views in an attribute."""
    return not any(part.attributes.keys() & {_VIEW, _VIEWS} for part in image.parts)


def _split_by_name(index: int, part: ExrPart, eye: str | None) -> dict[str, _Own]:
    """The part by view, as far as names tell them."""
    if eye is not None:
        return {eye: _Own(index, part, {})}
    views = eyes_of_channels(part.channel_names)
    return _split_channels(index, part, views) if views else {}


def _view_and_name(channel: str, views: Sequence[str]) -> tuple[str, str]:
    """View of a channel, and its name without it."""
    view, rest = view_and_rest(channel, views.__contains__)
    return views[0] if view is None else view, rest

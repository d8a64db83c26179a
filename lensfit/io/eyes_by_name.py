"""The two eyes of a stereo file that states no views, by the names that it uses."""

import re
from collections.abc import Callable, Iterable, Sequence

from lensfit.errors import ImageError
from lensfit.io.depth_channel import is_depth_name
from lensfit.io.exr import ExrPart

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

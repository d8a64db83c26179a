"""The two eyes of a stereo file that states no views, by the names that it uses."""

import re
from collections.abc import Iterable, Sequence

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
        words = name.split(".")
        place = next(
            (
                i
                for i in dict.fromkeys((len(words) - 2, 0))
                if 0 <= i < len(words) - 1 and words[i].lower() in EYES
            ),
            None,
        )
        eye = None if place is None else words[place]
        kept = [word for i, word in enumerate(words) if i != place]
        plain.setdefault(eye, []).append(".".join(kept))
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


def _eye_in(words: Iterable[str]) -> str | None:
    return next((word for word in words if word.lower() in EYES), None)


def _is_picture(names: Sequence[str]) -> bool:
    return _has_colours(names) and any(map(is_depth_name, names))


def _has_colours(names: Iterable[str]) -> bool:
    leaves = {name.lower() for name in names}
    return any(colours <= leaves for colours in _COLOURS)

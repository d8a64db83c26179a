"""Parts of one picture that state different cameras."""

from collections.abc import Sequence

from lensfit.errors import ImageError
from lensfit.io.exr import ExrPart
from lensfit.io.metadata import camera_words
from lensfit.plate.camera.header_source import HEADER, differ
from lensfit.plate.camera.plate_camera import PlateCamera
from lensfit.plate.camera.spelling import SPELT, option_of


def refuse_several_cameras(parts: Sequence[ExrPart], camera: PlateCamera) -> None:
    """Refuse parts of one view of which a value counts that another part contradicts.

    Parameters
    ----------
    camera : Of the picture; values that it has from better sources than its header
        decide for all parts.

    Raises
    ------
    ImageError : Two parts state different values.
    """
    stated = [
        (part, camera_words(part.attributes, None, camera.settings.aliases))
        for part in parts
    ]
    for name, spelt in SPELT.items():
        known = camera.known.get(name)
        if known is None or known.rank != HEADER:
            continue
        values = [
            (part, word.value, word.of_pinhole)
            for part, words in stated
            for word in words.get(name, ())[:1]
            if isinstance(word.value, float)
        ]
        for part, value, of_pinhole in values[1:]:
            first, counts, of_first = values[0]
            if of_pinhole == of_first and differ(counts, value):
                raise ImageError(
                    f"states two cameras: the {spelt} of part {part.name!r} is "
                    f"{value:g}, that of part {first.name!r} is {counts:g}",
                    remedy=f"state the views of its parts in the header entry view, "
                    f"or give one {spelt} with {option_of(name)}",
                )

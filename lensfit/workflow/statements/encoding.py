"""Encodings that were assumed, and fall-off that no encoding of light can have.

Integer TIFF and 16-bit PNG files hold linear samples as often as sRGB ones, and say
nothing of it: their encoding has to be stated. Read with the wrong one, light becomes a
power of itself. A stopped-down lens that nothing clips falls off by the fourth power
of the cosine of the field angle at most, but for the pupil's aberration, which makes it
less in wide lenses; what falls off far more was decoded wrongly, or lit unevenly.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any

from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.statements.contradiction import Contradiction

_STOPPED_DOWN, _BELOW_WIDEST = 5.6, 1.9
"""F-number, and times the widest photographed: rims clip the light no more."""
_BEYOND_COSINE, _BEYOND_STOPS = 1.3, 0.3
"""How many times, and stops more, than the law: pupils and lamps are not ideal."""
_MOST_NAMES = 3


def assumed_encodings(observed: Sequence[Observed]) -> Iterator[Contradiction]:
    """Files that may be linear or sRGB, of which nobody said which."""
    names = [one.image for one in observed if one.assumed_encoding and one.take]
    if not names:
        return
    more = len(names) - _MOST_NAMES
    listed = ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
    encoding = next(one.assumed_encoding for one in observed if one.assumed_encoding)
    yield Contradiction(
        kind="encoding",
        limit="undistortion",
        text=f"the encoding of {listed} is not stated and was taken for {encoding}: if "
        "they hold linear light, fall-off and blur are wrong",
        remedy='state encoding = "linear" or "srgb" for these views',
        statement="encoding",
        images=tuple(names),
    )


def impossible_fall_off(entries: Sequence[dict[str, Any]]) -> Iterator[Contradiction]:
    """Fall-off at a small stop that exceeds the cosine-fourth law by far.

    Parameters
    ----------
    entries : Of a report.
    """
    known = [c.get("f_number") for e in entries for c in e.get("fall_off") or []]
    least = max(_STOPPED_DOWN, _BELOW_WIDEST * min(filter(None, known), default=0.0))
    for entry in entries:
        c_mm = entry.get("principal_distance_mm")
        for curve in entry.get("fall_off") or []:
            stop = curve.get("f_number")
            if not c_mm or not stop or stop < least or curve["lighting_too"]:
                continue
            radius_mm, light = curve["radius_mm"][-1], curve["g"][-1]
            if not light or light <= 0:
                continue
            stops = -math.log2(light)
            lawful = 2 * math.log2(1 + (radius_mm / c_mm) ** 2)
            if stops > _BEYOND_COSINE * lawful + _BEYOND_STOPS:
                yield Contradiction(
                    kind="encoding",
                    limit="undistortion",
                    text=f"the light falls off by {stops:.2f} stops at f/{stop:g}, "
                    f"where the cosine-fourth law allows {lawful:.2f}: the encoding is "
                    "probably not the stated one",
                    remedy='check encoding ("linear" or "srgb") of the views, else '
                    "light the chart evenly",
                    statement="encoding",
                    stated=stops,
                    agrees_with=lawful,
                )
                return

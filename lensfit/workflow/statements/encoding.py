"""Encodings that were assumed, and fall-off that no encoding of light can have.

Integer TIFF and 16-bit PNG files hold linear samples as often as sRGB ones, and do not
record which: their encoding has to be stated. Read with the wrong one, light becomes a
power of itself. A stopped-down lens that nothing clips falls off by the fourth power
of the cosine of the field angle at most, but for the pupil's aberration, which makes it
less in wide lenses; a far larger fall-off was decoded wrongly, or lit unevenly. And
defocus moves light but absorbs none: at one stop a dot's light, summed, falls off
alike in focus and out of it. A power or a logarithm of light does not keep its sum, so
that fall-off then changes with focus, and is less than any lens has.
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
_LEAST_PART, _LAW_STOPS = 0.3, (0.4, 1.5)
"""Of the law, below which no usual pupil keeps the light; where it says enough, and the
lens is not so wide that its pupil may grow much with the field."""
_FOCUS_STOPS = 0.2
"""By which fall-off may change with focus at a small stop."""
_MOST_NAMES = 3


def assumed_encodings(observed: Sequence[Observed]) -> Iterator[Contradiction]:
    """Files that may be linear or sRGB, with no encoding stated."""
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
    """Fall-off at a small stop that no linear light can have.

    It exceeds the cosine-fourth law by far, is far below it, or changes with focus.

    Parameters
    ----------
    entries : Of a report.
    """
    found = [*_excess_fall_off(entries), *_changed_by_focus(entries)]
    yield from (found or list(_below_the_law(entries)))[:1]


def _excess_fall_off(entries: Sequence[dict[str, Any]]) -> Iterator[Contradiction]:
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
            lawful = _lawful_stops(radius_mm, c_mm)
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


def _changed_by_focus(entries: Sequence[dict[str, Any]]) -> Iterator[Contradiction]:
    """At the smallest stop that several states of focus were photographed at."""
    by_stop: dict[tuple[float, float], list[float]] = {}
    for entry in entries:
        for stop, _, stops in _curves(entry):
            by_stop.setdefault((entry["focal_length_mm"], stop), []).append(stops)
    several = {key: stops for key, stops in by_stop.items() if len(stops) > 1}
    for focal_mm, stop in sorted(several, key=lambda key: -key[1]):
        stops = several[focal_mm, stop]
        least = max(min(stops), 0.0) + 0.0  # no minus before a zero
        if max(stops) - least > _FOCUS_STOPS:
            yield _nonlinear(
                f"at f/{stop:g} the light falls off by {least:.2f} stops at one focus "
                f"distance and by {max(stops):.2f} at another, though blur takes "
                "no light away",
                max(stops) - least,
                0.0,
            )
        return


def _below_the_law(entries: Sequence[dict[str, Any]]) -> Iterator[Contradiction]:
    """At the smallest stop, which rims clip least."""
    for entry in entries:
        curves = list(_curves(entry))
        for stop, lawful, stops in curves[-1:]:
            low, high = _LAW_STOPS
            if low < lawful < high and stops < _LEAST_PART * lawful:
                yield _nonlinear(
                    f"the light falls off by {stops:.2f} stops only at f/{stop:g}, "
                    f"where the cosine-fourth law gives {lawful:.2f}",
                    stops,
                    lawful,
                )


def _curves(entry: dict[str, Any]) -> Iterator[tuple[float, float, float]]:
    """F-number, lawful stops and measured stops at the end of each fall-off curve of
    charts that shine themselves, widest first."""
    c_mm = entry.get("principal_distance_mm")
    for curve in entry.get("fall_off") or []:
        stop = curve.get("f_number")
        if not c_mm or not stop or curve["lighting_too"]:
            continue
        radius_mm, light = curve["radius_mm"][-1], curve["g"][-1]
        if light and light > 0:
            yield stop, _lawful_stops(radius_mm, c_mm), -math.log2(light)


def _lawful_stops(radius_mm: float, principal_distance_mm: float) -> float:
    """By the fourth power of the cosine of the field angle."""
    return 2 * math.log2(1 + (radius_mm / principal_distance_mm) ** 2)


def _nonlinear(text: str, stated: float, agrees_with: float) -> Contradiction:
    return Contradiction(
        kind="encoding",
        limit="undistortion",
        text=f"{text}: the files are probably not linear, and the encoding is not the "
        "stated one",
        remedy='check encoding ("linear", "srgb" or a logarithm) of the views',
        statement="encoding",
        stated=stated,
        agrees_with=agrees_with,
    )

"""Encodings: those that were assumed, and whether samples are linear in light.

Integer TIFF and 16-bit PNG files hold linear samples as often as sRGB ones, and do not
record which: their encoding has to be stated. Read with the wrong one, light becomes a
power of itself. A stopped-down lens that nothing clips falls off by the fourth power
of the cosine of the field angle at most, but for the pupil's aberration, which makes it
less in wide lenses; a far larger fall-off was decoded wrongly, or lit unevenly. And
defocus moves light but absorbs none: at one stop a dot's light, summed, falls off
alike in focus and out of it. A power or a logarithm of light does not keep its sum, so
that fall-off then changes with focus, and is less than any lens has.

Of one photograph how the sum of a small dot stays the same tells whether its samples
are linear in light. Dots of one size fall on the pixel grid as chance has it: one on
the middle of a pixel is concentrated in it, one on a corner is spread over four. Their
light, summed, is the same. Of samples that are a power g of light it is not: spread
over an area A, light per pixel is as 1/A and the sum of its powers as A^(1 - g). With S
the sum of samples s of a dot and C = sum s^2 / S^2 its concentration, which is as 1/A,

    d log S / d log C = g - 1,

whatever lens, blur and fall-off, since only neighbours are compared: what changes
slowly over the frame is taken out of both as a polynomial. Holes of a chart differ in
size, which changes S and C too; so only that part of both counts that goes with where
on its pixel a dot lies (that phase is the instrument, in the words of statistics; the
slope is by two-stage least squares). A power g of 0.45 is that of video and sRGB files
read as linear, 2.2 that of linear files read as sRGB. Colours that were interpolated
from a mosaic depart from 1 by up to 0.3; sharpening, whose dark halos are clipped at
black, by more.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lensfit.fitting.chart_view import View
from lensfit.report.evidence import sentence_list
from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.statements.contradiction import Contradiction

_DEGREE = 6
_FEWEST_PER_TERM = 3
_OUTLIER = 4.0
"""Robust standard deviations."""
_KNOWN = 0.05
"""Standard deviation up to which a power counts."""
_LEAST_SPREAD = 0.008
"""Of the logarithm of concentration, rms: below it dots are too wide for the grid."""
_LINEAR = 0.62, 1.4
"""Powers of linear samples, and of tone curves and mosaics."""
_UNLIKE_OTHERS = 0.25
_SIGNIFICANT = 5.0
_FEWEST_OTHERS = 2
_MOST_NAMES = 3


class Power(NamedTuple):
    """Of light, that the samples of a photograph are; and its standard deviation."""

    value: float
    standard_deviation: float


def power_of_light(take: View) -> Power | None:
    """None where dots are dark, blurred over many pixels, or too few."""
    images, seen = take.dot_images, take.observations
    if images is None or seen.are_lines or seen.are_corners or not seen.bright:
        return None
    if images.cell_px != 1 or images.mosaic is not None:
        return None
    light = np.where(images.valid, images.light, 0.0)[:, 1]
    total = light.sum((1, 2))
    whole = ~images.clipped.any((1, 2, 3)) & ~seen.overlapping[images.marks]
    good = whole & (total > 0)
    terms = _smooth_terms(take)[good]
    if good.sum() < _FEWEST_PER_TERM * terms.shape[1]:
        return None
    squares = (light[good] ** 2).sum((1, 2)) / total[good] ** 2
    values = np.log(np.column_stack([total[good], squares]))
    phases = _phases(seen.points_px[images.marks[good]])
    rest = _from_neighbours(terms, np.column_stack([values, phases]))
    usual = _is_usual(rest[:, 0]) & _is_usual(rest[:, 1])
    by_sum, by_square, by_phase = rest[usual, 0], rest[usual, 1], rest[usual, 2:]
    seen_by_phase = by_phase @ np.linalg.lstsq(by_phase, by_square, rcond=None)[0]
    spread = seen_by_phase @ seen_by_phase
    if spread < _LEAST_SPREAD**2 * len(by_sum):
        return None
    slope = float(seen_by_phase @ by_sum / spread)
    left = by_sum - slope * by_square
    freedom = max(len(left) - terms.shape[1], 1)
    return Power(1 + slope, float(np.sqrt(left @ left / freedom / spread)))


def _phases(points_px: np.ndarray) -> np.ndarray:
    """Where on its pixel each point lies, as waves of one and of half a pixel."""
    turn = 2 * np.pi * np.column_stack([points_px, 2 * points_px])
    return np.column_stack([np.cos(turn), np.sin(turn)])


def nonlinear_views(takes: Sequence[View]) -> list[Contradiction]:
    """At most one: the encoding of all views, or of those unlike the others."""
    powers = {take.name: power_of_light(take) for take in takes}
    known = {
        name: power
        for name, power in powers.items()
        if power is not None and power.standard_deviation < _KNOWN
    }
    if not known:
        return []
    usual = float(np.median([power.value for power in known.values()]))
    if not _LINEAR[0] < usual < _LINEAR[1]:
        return [_not_linear(usual, tuple(known))]
    unlike = {
        name: power.value
        for name, power in known.items()
        if abs(power.value - usual)
        > max(_UNLIKE_OTHERS, _SIGNIFICANT * power.standard_deviation)
    }
    if not unlike or len(known) - len(unlike) < _FEWEST_OTHERS:
        return []
    return [_developed_otherwise(unlike, usual)]


def _smooth_terms(take: View) -> np.ndarray:
    """Polynomials over the frame at the dots that have images."""
    assert take.dot_images is not None
    seen = take.observations
    half = np.asarray(seen.image_size_px, float) / 2
    place = (seen.points_px[take.dot_images.marks] - half) / np.linalg.norm(half)
    x, y = place.T
    orders = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    return np.stack([x**i * y**j for i, j in orders], 1)


def _from_neighbours(terms: np.ndarray, values: np.ndarray) -> np.ndarray:
    return values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0]


def _is_usual(values: np.ndarray) -> np.ndarray:
    size = np.abs(values)
    return size <= _OUTLIER * 1.4826 * np.median(size)


def _not_linear(power: float, images: tuple[str, ...]) -> Contradiction:
    probable = "srgb" if power < 1 else "linear"
    are = "coded" if power < 1 else "linear"
    return Contradiction(
        kind="encoding",
        limit="undistortion",
        text="the encoding is not the stated one: as read, samples are light to the "
        f"power {power:.2f}, so the files are probably {are}",
        remedy=f'check encoding of the views, probably "{probable}"',
        statement="encoding",
        stated=1.0,
        agrees_with=power,
        images=images,
    )


def _developed_otherwise(unlike: dict[str, float], usual: float) -> Contradiction:
    names = [Path(name).stem for name in list(unlike)[:_MOST_NAMES]]
    power = float(np.median(list(unlike.values())))
    return Contradiction(
        kind="encoding",
        limit="undistortion",
        text=f"the encoding of {sentence_list(names)} is not that of the others: "
        f"samples are light to the power {power:.2f} there, {usual:.2f} elsewhere",
        remedy="develop all photographs alike, without curves, and check encoding",
        statement="encoding",
        stated=usual,
        agrees_with=power,
        images=tuple(unlike),
    )


_STOPPED_DOWN, _BELOW_WIDEST = 5.6, 1.9
"""F-number, and times the widest photographed: rims clip the light no more."""
_BEYOND_COSINE, _BEYOND_STOPS = 1.3, 0.3
"""How many times, and stops more, than the law: pupils and lamps are not ideal."""
_LEAST_PART, _LAW_STOPS = 0.3, (0.4, 1.5)
"""Of the law, below which no usual pupil keeps the light; where it says enough, and the
lens is not so wide that its pupil may grow much with the field."""
_FOCUS_STOPS = 0.2
"""By which fall-off may change with focus at a small stop."""


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

"""Checks of a preset that types cannot express: order, lengths, physical limits.

No state stands twice, a correlation matrix is one that numbers can have, terms of a
blur block exist, and every field point receives light. Stop and rims are discs with
their centres on the line through the field point, so that they leave the pupil open
exactly where the intervals they cut from that line overlap (`lensfit.optics.pupil` has
the formulas). Both are checked from the axis to the furthest corner of the sensor, for
the reference stop and every measured one.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np

from lensfit.errors import PresetError
from lensfit.preset.blocks import (
    AberrationTerm,
    Blur,
    Camera,
    Covariance,
    Distortion,
    FallOff,
    LateralColour,
    Pupil,
    fall_off_names,
    lateral_names,
)
from lensfit.preset.entry import Entry
from lensfit.preset.schema import Preset

_RADII = 32
_LONGEST_BY_COLOUR = 2


def blur_faults(blur: Blur, frame_radius_mm: float) -> Iterator[tuple[str, str]]:
    """Key and sentence of everything in a block that cannot be right."""
    seen: set[AberrationTerm] = set()
    for index, term in enumerate(blur.aberrations):
        for key, what in _term_faults(term):
            yield f"aberrations[{index}].{key}", what
        bare = msgspec.structs.replace(term, um=0.0, um_by_colour=())
        if bare in seen:
            yield f"aberrations[{index}]", "stands twice"
        seen.add(bare)
    stops = [stop.f_number for stop in blur.stops]
    if len(set(stops)) < len(stops):
        yield "stops", "an f-number stands twice"
    if blur.pupil.blades in (1, 2):
        yield "pupil.blades", "is no iris; 0 is round, 3 and more are blades"
    if blur.uncertainty is not None:
        count = len(blur.uncertainty.numbers)
        for index, move in enumerate(blur.uncertainty.moves):
            if len(move) != count:
                what = f"has {len(move)} numbers for {count} names"
                yield f"uncertainty.moves[{index}]", what
    yield from _pupil_faults(blur, frame_radius_mm / blur.field_radius_mm)


def _term_faults(term: AberrationTerm) -> Iterator[tuple[str, str]]:
    if term.order > term.degree or (term.degree - term.order) % 2:
        yield "order", f"does not go with degree {term.degree}"
    field = abs(term.field_order)
    if field > term.field_degree or (term.field_degree - field) % 2:
        yield "field_order", f"does not go with field_degree {term.field_degree}"
    if term.part == "im" and not (term.order or term.field_order):
        yield "part", 'is zero everywhere: a term of order 0 has only "re"'
    if len(term.um_by_colour) > _LONGEST_BY_COLOUR:
        yield "um_by_colour", f"has more than {_LONGEST_BY_COLOUR} coefficients"


def _pupil_faults(blur: Blur, furthest: float) -> Iterator[tuple[str, str]]:
    """Radii and overlap, up to the furthest field point."""
    radii = [1.0] + [
        stop.radius_ratio / (2 * stop.f_number * blur.reference_sine)
        for stop in blur.stops
    ]
    for step in range(_RADII + 1):
        h = furthest * step / _RADII
        where = f"{h * blur.field_radius_mm:.3g} mm off the axis, inside the frame"
        for index, rim in enumerate(blur.pupil.rims):
            if rim.radius[0] + rim.radius[1] * h * h <= 0:
                yield f"pupil.rims[{index}].radius", f"is not positive {where}"
                return
        if any(_is_closed(blur.pupil, h, radius) for radius in radii):
            yield "pupil", f"lets no light through {where}"
            return


def _is_closed(pupil: Pupil, h: float, stop_radius: float) -> bool:
    shift = pupil.stop_shift[0] + pupil.stop_shift[1] * h * h
    centre = h * shift * stop_radius**2
    low, high = centre - stop_radius, centre + stop_radius
    for rim in pupil.rims:
        centre = h * (rim.shift[0] + rim.shift[1] * h * h)
        radius = rim.radius[0] + rim.radius[1] * h * h
        low, high = max(low, centre - radius), min(high, centre + radius)
    return low >= high


_ROUNDING = 1e-6
"""How far correlations may be off those of any draws."""


def covariance_faults(
    covariance: Covariance, known: Sequence[str] | None = None
) -> Iterator[tuple[str, str]]:
    """Key and sentence of what cannot be right; the later ones only where the earlier
    are not.

    Parameters
    ----------
    known : The parameters that there are; None for any.
    """
    count = len(covariance.parameters)
    rows = [len(row) for row in covariance.correlation]
    if len(covariance.standard_deviation) != count:
        yield "standard_deviation", f"needs {count} numbers, one for each parameter"
    elif rows != list(range(1, count + 1)):
        yield "correlation", f"needs {count} rows of 1 to {count} numbers"
    elif len(set(covariance.parameters)) < count:
        yield "parameters", "one stands twice"
    elif known is not None and not set(covariance.parameters) <= set(known):
        (first, *_) = (n for n in covariance.parameters if n not in known)
        yield "parameters", f"{first!r} is none of {', '.join(known)}"
    elif any(deviation < 0 for deviation in covariance.standard_deviation):
        yield "standard_deviation", "is negative somewhere"
    else:
        yield from _correlation_faults(covariance)


def _correlation_faults(covariance: Covariance) -> Iterator[tuple[str, str]]:
    every = [value for row in covariance.correlation for value in row]
    if any(abs(value) > 1 + _ROUNDING for value in every):
        yield "correlation", "is beyond -1 to 1 somewhere"
    elif any(abs(row[-1] - 1) > _ROUNDING for row in covariance.correlation):
        yield "correlation", "a row does not end with 1"
    elif every and np.linalg.eigvalsh(covariance.correlations())[0] < -_ROUNDING:
        yield "correlation", "is no possible correlation matrix"


_LONGEST = {"decentering": 4, "thin_prism": 4, "anamorphic": 8}
_LOPSIDED = 2
"""Coefficients of a channel that differ between azimuths."""
_DARKEST = 50.0
"""Loss as -ln of the light: less than 1e-21 of it is none."""
_LONGEST_MM = 1e9
"""A thousand kilometres; lenses that are nearly telecentric have pupils far away."""
_LARGEST_F_NUMBER = 1000.0


def check_preset(preset: Preset, where: str | Path) -> None:
    """Refuse a preset with a key that cannot be right.

    Raises
    ------
    PresetError : There is one; the first is named.
    """
    for index, entry in enumerate(preset.entries):
        for key, what in _faults(entry, _frame_radius_mm(entry, preset.camera)):
            raise PresetError(f"entries[{index}].{key}: {what}", where=where)
    states: dict[tuple[float, float | None], int] = {}
    for index, entry in enumerate(preset.entries):
        state = (entry.focal_length_mm, entry.focus_distance_mm)
        if state in states:
            raise PresetError(
                f"entries[{index}]: the lens at {entry} is entries[{states[state]}] "
                "again; keep one of them",
                where=where,
            )
        states[state] = index


def _frame_radius_mm(entry: Entry, camera: Camera) -> float:
    """From the principal point to the furthest corner of the sensor."""
    x, y = entry.projection.principal_point_mm
    return math.hypot(
        camera.sensor_width_mm / 2 + abs(x), camera.sensor_height_mm / 2 + abs(y)
    )


def _faults(entry: Entry, frame_radius_mm: float) -> Iterator[tuple[str, str]]:
    for key, length in _lengths(entry):
        if not abs(length) <= _LONGEST_MM:
            yield key, f"{length:g} is no length of a lens, in mm"
    for key, what in _distortion_faults(entry.distortion):
        yield f"distortion.{key}", what
    if entry.lateral_colour is not None:
        for key, what in _lateral_faults(entry.lateral_colour):
            yield f"lateral_colour.{key}", what
    stops = [fall_off.f_number for fall_off in entry.fall_off]
    if len(set(stops)) < len(stops):
        yield "fall_off", "an f-number stands twice"
    for index, fall_off in enumerate(entry.fall_off):
        for key, what in _fall_off_faults(fall_off):
            yield f"fall_off[{index}].{key}", what
    if entry.blur is not None:
        for key, what in blur_faults(entry.blur, frame_radius_mm):
            yield f"blur.{key}", what
    if entry.covariance is not None:
        for key, what in covariance_faults(entry.covariance):
            yield f"covariance.{key}", what


def _lengths(entry: Entry) -> Iterator[tuple[str, float]]:
    projection = entry.projection
    yield "focal_length_mm", entry.focal_length_mm
    yield "projection.principal_distance_mm", projection.principal_distance_mm
    yield "projection.entrance_pupil_offset_mm", projection.entrance_pupil_offset_mm
    for axis, place in zip("xy", projection.principal_point_mm, strict=True):
        yield f"projection.principal_point_mm.{axis}", place
    yield "distortion.reference_radius_mm", entry.distortion.reference_radius_mm


def _distortion_faults(distortion: Distortion) -> Iterator[tuple[str, str]]:
    x0, y0, x1, y1 = distortion.valid_box
    if not (x0 < x1 and y0 < y1):
        yield "valid_box", "is no box x0, y0, x1, y1 with x0 < x1 and y0 < y1"
    for key, longest in _LONGEST.items():
        if len(getattr(distortion, key)) > longest:
            yield key, f"has more than {longest} coefficients"
    field = distortion.field
    if field is None:
        return
    count = (field.degree + 1) * (field.degree + 2) // 2 - 6
    for axis in ("x", "y"):
        if len(getattr(field, axis)) != count:
            yield (
                f"field.{axis}",
                f"needs {count} coefficients at degree {field.degree}",
            )


def _lateral_faults(lateral: LateralColour) -> Iterator[tuple[str, str]]:
    for channel in ("r", "b"):
        for key in ("strain", "decentering"):
            if len(getattr(getattr(lateral, channel), key)) not in (0, _LOPSIDED):
                yield f"{channel}.{key}", f"needs {_LOPSIDED} coefficients, or none"
    if lateral.covariance is None:
        return
    for channel in ("r", "b"):
        covariance = getattr(lateral.covariance, channel)
        names = lateral_names(len(getattr(lateral, channel).radial))
        for key, what in covariance_faults(covariance, names):
            yield f"covariance.{channel}.{key}", what


def _fall_off_faults(fall_off: FallOff) -> Iterator[tuple[str, str]]:
    if fall_off.f_number is not None and fall_off.f_number > _LARGEST_F_NUMBER:
        yield "f_number", f"{fall_off.f_number:g} is none of a lens"
    for key in ("r", "g", "b"):
        control = getattr(fall_off, key)
        if not control or len(control) != len(fall_off.g):
            yield key, "needs at least one number, and as many as the other channels"
        if any(b < a for a, b in pairwise((0.0, *control))):
            yield key, "falls somewhere; control values rise from 0"
        if max(control, default=0.0) > _DARKEST:
            yield key, f"is over {_DARKEST:g}: no light would be left"
    if fall_off.covariance is None:
        return
    for channel in ("r", "g", "b"):
        covariance = getattr(fall_off.covariance, channel)
        names = fall_off_names(channel, len(fall_off.g))
        for key, what in covariance_faults(covariance, names):
            yield f"covariance.{channel}.{key}", what

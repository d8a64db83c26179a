"""Entries between two measured states: how focusing and zooming change the image.

Focusing a lens as a whole, 1/c (c the principal distance) is exactly linear in the
vergence of the focus distance as seen from the entrance pupil; lenses with inner or
front focusing bend that line little. The weight of two neighbours is linear in that
vergence, and so is everything else that changes with focus.

Zooming, the ratio c/f is constant where the front group focuses and linear in f where
the whole lens does; it is interpolated linearly in f, like nearly all the rest.
Distortion that is the same function of the field angle at every focal length has
coefficients a_k of r^2k proportional to f^-2k (r on the sensor); the radial ones are
interpolated linearly in that.

All of this is exact at the measured states, continuous there, and keeps every number
between those of its neighbours.
"""

import math
from itertools import zip_longest

import msgspec

from lensfit.preset.blend import blend, blended
from lensfit.preset.entry import Entry
from lensfit.units import dioptres_from_mm, m_from_mm


def interpolated_in_focus(
    first: Entry, second: Entry, focus_distance_mm: float
) -> Entry:
    """The entry focused between two of one focal length.

    Raises
    ------
    PresetError : The two are of different models.
    """
    weight = focus_weight(first, second, focus_distance_mm)
    mixed = blend(first, second, weight)
    inverse = blended(
        1 / first.projection.principal_distance_mm,
        1 / second.projection.principal_distance_mm,
        weight,
    )
    mixed = _with_principal_distance(mixed, 1 / inverse)
    return msgspec.structs.replace(mixed, focus_distance_mm=focus_distance_mm)


def interpolated_in_focal_length(
    first: Entry, second: Entry, focal_length_mm: float
) -> Entry:
    """The entry zoomed between two.

    Raises
    ------
    PresetError : The two are of different models.
    """
    span_mm = second.focal_length_mm - first.focal_length_mm
    weight = (focal_length_mm - first.focal_length_mm) / span_mm
    mixed = blend(first, second, weight)
    ratio = blended(
        first.projection.principal_distance_mm / first.focal_length_mm,
        second.projection.principal_distance_mm / second.focal_length_mm,
        weight,
    )
    mixed = _with_principal_distance(mixed, ratio * focal_length_mm)
    slopes = (one.distortion.radial_log_slope for one in (first, second))
    radial = tuple(
        blended(a, b, _angular_weight(first, second, focal_length_mm, 2 * order))
        for order, (a, b) in enumerate(zip_longest(*slopes, fillvalue=0.0), 1)
    )
    distortion = msgspec.structs.replace(mixed.distortion, radial_log_slope=radial)
    return msgspec.structs.replace(mixed, distortion=distortion)


def _angular_weight(
    first: Entry, second: Entry, focal_length_mm: float, power: int
) -> float:
    """Share of `second` of what goes as the focal length to minus `power`."""
    high = (second.focal_length_mm / first.focal_length_mm) ** -power
    requested = (focal_length_mm / first.focal_length_mm) ** -power
    return (1 - requested) / (1 - high)


def focus_weight(first: Entry, second: Entry, focus_distance_mm: float) -> float:
    """Share of `second` at a focus distance between both, 0 to 1.

    Both state theirs. Linear in the vergence from the entrance pupil; from the sensor,
    where a stated pupil lies beyond the nearest focus and cannot be meant.
    """
    assert first.focus_distance_mm is not None
    assert second.focus_distance_mm is not None
    low = dioptres_from_mm(first.focus_distance_mm)
    high = dioptres_from_mm(second.focus_distance_mm)
    requested = dioptres_from_mm(focus_distance_mm)
    from_sensor = (requested - low) / (high - low)
    pupil_m = [
        m_from_mm(one.projection.entrance_pupil_offset_mm) for one in (first, second)
    ]
    pupil_m.append(blended(pupil_m[0], pupil_m[1], from_sensor))
    seen = [
        v / (1 - v * offset)
        for v, offset in zip((low, high, requested), pupil_m, strict=True)
        if v * offset < 0.9
    ]
    if len(seen) < 3 or not math.copysign(1, high - low) * (seen[1] - seen[0]) > 0:
        return from_sensor
    return min(max((seen[2] - seen[0]) / (seen[1] - seen[0]), 0.0), 1.0)


def _with_principal_distance(entry: Entry, principal_distance_mm: float) -> Entry:
    projection = msgspec.structs.replace(
        entry.projection, principal_distance_mm=principal_distance_mm
    )
    return msgspec.structs.replace(entry, projection=projection)

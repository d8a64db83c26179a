"""Fall-off at f-numbers that nobody photographed, from the shape of the pupil.

The area of the opening, in direction cosines, over that on the axis is the relative
illumination (`lensfit.optics.pupil`): rims that clip at a wide stop let a smaller one
through whole, and what is left then is the pupil's own foreshortening, natural
fall-off. It is written down as measured fall-off is (`lensfit.optics.falloff`): a
Bernstein polynomial of the squared radius whose control values never fall, by least
squares with non-negative steps, for the mean over all azimuths.
"""

from collections.abc import Iterable

import msgspec

from lensfit.preset.blocks import FallOff
from lensfit.preset.blur_of_block import lens_blur
from lensfit.preset.entry import Entry
from lensfit.preset.fall_off_control import control_of, pupil_loss

TERMS = 7
"""Control values: enough for the kink where a rim begins to clip."""
FULL_STOPS = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 22.0)
_SAME_STOP = 1.05


def predicted_fall_off(
    entry: Entry, f_numbers: Iterable[float], valid_radius_mm: float | None = None
) -> tuple[FallOff, ...]:
    """Fall-off of an entry that has a blur, at each f-number; marked as predicted.

    Parameters
    ----------
    entry : Only its blur, projection and focus are read.
    valid_radius_mm : From the principal point, where the control values end; that of
        the measured fall-off, or of the measured distortion, when left out.

    Raises
    ------
    ValueError : The entry has no blur.
    """
    if valid_radius_mm is None:
        valid_radius_mm = _measured_radius_mm(entry)
    return tuple(_fall_off(entry, float(n), valid_radius_mm) for n in f_numbers)


def with_predicted_fall_off(entry: Entry) -> Entry:
    """The entry with fall-off at the full stops that were not photographed.

    Nothing is added to an entry without a blur, or whose fall-off belongs to no stated
    f-number.
    """
    measured = [one.f_number for one in entry.fall_off]
    if entry.blur is None or not entry.blur.stops or None in measured:
        return entry
    known = [one for one in measured if one is not None]
    widest = min([*known, *(stop.f_number for stop in entry.blur.stops)])
    wanted = [
        number
        for number in FULL_STOPS
        if number > widest / _SAME_STOP
        and all(not 1 / _SAME_STOP < number / one < _SAME_STOP for one in known)
    ]
    every = (*entry.fall_off, *predicted_fall_off(entry, wanted))
    ordered = sorted(every, key=lambda one: one.f_number or 0.0)
    return msgspec.structs.replace(entry, fall_off=tuple(ordered))


def _measured_radius_mm(entry: Entry) -> float:
    if entry.fall_off:
        return max(one.valid_radius_mm for one in entry.fall_off)
    return entry.distortion.valid_radius * entry.distortion.reference_radius_mm


def _fall_off(entry: Entry, f_number: float, valid_radius_mm: float) -> FallOff:
    blur = lens_blur(entry, f_number, entry.focus_distance_mm)
    loss = pupil_loss(
        blur.pupil,
        blur.stop_radius,
        float(blur.aberration.field_radius_mm),
        valid_radius_mm,
    )
    control = tuple(control_of(loss, TERMS).tolist())
    return FallOff(f_number, valid_radius_mm, control, control, control, predicted=True)

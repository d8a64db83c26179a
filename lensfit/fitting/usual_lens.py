"""The entrance pupil of usual lenses: a prior for lenses not yet measured.

The pupil lies near that of a thin lens. It is farther in front in retrofocus lenses,
whose focal length is shorter than the back focal distance that a camera needs, and
farther back in telephoto lenses. For 13 published designs of 14 to 200 mm, from
telephoto to retrofocus, it is within 1.5 of the widths below.

The pupil shifts along the axis with field angle (pupil aberration,
`lensfit.optics.pupil_shift`). Traced through sixteen published designs, f/1.1 to f/5,
to 17 degrees off axis, the shift per squared sine of the field angle is

    -0.7 f / N^2

within .15 focal lengths rms, N being the widest f-number: fast lenses have strong
elements in front of the stop. In a retrofocus lens of 100 degrees it is .25 focal
lengths larger; a telephoto lens can differ much (-2.8 for one of f/5.6).
"""

import math
from typing import NamedTuple

_PUPIL_MM = 70.0
_PUPIL_FOCAL_LENGTHS = 0.7
_RETROFOCUS_BELOW_MM, _RETROFOCUS_SLOPE = 50.0, 1.5
_TELEPHOTO_BEYOND_MM, _TELEPHOTO_SLOPE = 100.0, 2.0
_PUPIL_SHIFT = -0.7
"""Times the square of the f-number, in focal lengths."""
_PUPIL_SHIFT_DEVIATION, _PUPIL_SHIFT_DEVIATION_OF_ANY = 0.25, 0.5
"""In focal lengths, for lenses of known and of unknown f-number; a little larger than
the scatter, because the designs are not a random sample."""


class KnownPupil(NamedTuple):
    """Prior of the entrance pupil's position in front of the sensor.

    Attributes
    ----------
    offset_mm, standard_deviation_mm : Of a Gaussian.
    common_deviation_mm : Standard deviation of the error that all states of the lens
        have in common; 0 if the value does not come from another state.
    measured : Whether photographs at another focus distance determined it.
    """

    offset_mm: float
    standard_deviation_mm: float
    common_deviation_mm: float = 0.0
    measured: bool = False


class KnownPupilShift(NamedTuple):
    """Prior of the shift of the entrance pupil with field angle.

    Attributes
    ----------
    shift_mm, standard_deviation_mm : Towards the scene, per squared sine of the angle.
    common_deviation_mm, measured : As of `KnownPupil`.
    """

    shift_mm: float
    standard_deviation_mm: float
    common_deviation_mm: float = 0.0
    measured: bool = False


class KnownPerspective(NamedTuple):
    """Prior of where chief rays cross the axis; anamorphic lenses ignore the shift."""

    pupil: KnownPupil
    pupil_shift: KnownPupilShift


def usual_pupil(focal_length_mm: float) -> KnownPupil:
    """The entrance pupil of lenses of this focal length."""
    short_mm = max(_RETROFOCUS_BELOW_MM - focal_length_mm, 0.0)
    long_mm = max(focal_length_mm - _TELEPHOTO_BEYOND_MM, 0.0)
    width_mm = math.hypot(_PUPIL_MM, _PUPIL_FOCAL_LENGTHS * focal_length_mm)
    offset_mm = focal_length_mm + _RETROFOCUS_SLOPE * short_mm
    return KnownPupil(offset_mm - _TELEPHOTO_SLOPE * long_mm, width_mm)


def usual_pupil_shift(
    focal_length_mm: float, widest_f_number: float | None
) -> KnownPupilShift:
    """Shift of the pupil with field angle of lenses of this widest f-number, which is
    None if unknown."""
    if widest_f_number is None:
        return KnownPupilShift(0.0, _PUPIL_SHIFT_DEVIATION_OF_ANY * focal_length_mm)
    shift_mm = _PUPIL_SHIFT * focal_length_mm / widest_f_number**2
    return KnownPupilShift(shift_mm, _PUPIL_SHIFT_DEVIATION * focal_length_mm)


def magnification_at(focal_length_mm: float, focus_distance_mm: float) -> float:
    """Magnification of a thin lens focused at a distance from the sensor; 1 if it
    cannot be focused so near.

    From s = f (2 + m + 1 / m).
    """
    half = focus_distance_mm / focal_length_mm / 2 - 1
    if not math.isfinite(half):
        return 0.0
    return 1.0 if half <= 1 else half - math.sqrt(half * half - 1)

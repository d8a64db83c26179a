"""The entrance pupil of usual lenses: a prior for lenses not yet measured.

The pupil lies near that of a thin lens. It is farther in front in retrofocus lenses,
whose focal length is shorter than the back focal distance that a camera needs, and
farther back in telephoto lenses. For 13 published designs of 14 to 200 mm, from
telephoto to retrofocus, it is within 1.5 of the widths below.

The pupil shifts along the axis with field angle (pupil aberration,
`lensfit.optics.projection`). Traced through sixteen published designs, f/1.1 to f/5,
to 17 degrees off axis, the shift per squared sine of the field angle is

    -0.7 f / N^2

within .15 focal lengths rms, N being the widest f-number: fast lenses have strong
elements in front of the stop. A lens of small field may have a pupil much larger than
its stop, and shifts by many focal lengths per squared sine (65 for a zoom at 200 mm):
there it is the shift at the frame's corner that is like that of others. Over 17 states
of 13 designs, 14 to 200 mm, it is within .02 focal lengths of the above in the median
lens, within .13 in all.

Beyond the squared sine the shift goes on with the fourth power, of which a fit to the
squared one leaves half at the corner: in the same designs a tenth of the shift there,
and in wide ones .2 focal lengths times the squared sine more.
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
_PUPIL_SHIFT_DEVIATION_AT_CORNER = 0.02
"""In focal lengths: of the shift itself, at the corner of the frame."""
_NEXT_ORDER_OF_SHIFT, _NEXT_ORDER_OF_FIELD = 0.1, 0.2
"""The neglected fourth power: a share of the shift, and in focal lengths per squared
sine at the corner."""


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
    focal_length_mm: float, widest_f_number: float | None, corner_mm: float
) -> KnownPupilShift:
    """Shift of the pupil with field angle of lenses of this widest f-number, which is
    None if unknown.

    Parameters
    ----------
    corner_mm : Of the frame, from its middle.
    """
    shift, width = 0.0, _PUPIL_SHIFT_DEVIATION_OF_ANY
    if widest_f_number is not None:
        shift, width = _PUPIL_SHIFT / widest_f_number**2, _PUPIL_SHIFT_DEVIATION
    sine2 = _squared_sine(corner_mm, focal_length_mm)
    width = math.hypot(width, _PUPIL_SHIFT_DEVIATION_AT_CORNER / sine2)
    return KnownPupilShift(shift * focal_length_mm, width * focal_length_mm)


def next_order_of_pupil_shift_mm(
    shift_mm: float, focal_length_mm: float, corner_mm: float
) -> float:
    """Standard deviation of a shift per squared sine by the neglected fourth power.

    Parameters
    ----------
    corner_mm : Of what the shift was fitted to, on the image.
    """
    of_field = _NEXT_ORDER_OF_FIELD * _squared_sine(corner_mm, focal_length_mm)
    return math.hypot(_NEXT_ORDER_OF_SHIFT * shift_mm, of_field * focal_length_mm)


def _squared_sine(radius_mm: float, focal_length_mm: float) -> float:
    """Of the field angle at this radius of an undistorted image."""
    return 1 / (1 + (focal_length_mm / radius_mm) ** 2)


def magnification_at(focal_length_mm: float, focus_distance_mm: float) -> float:
    """Magnification of a thin lens focused at a distance from the sensor; 1 if it
    cannot be focused so near.

    From s = f (2 + m + 1 / m).
    """
    half = focus_distance_mm / focal_length_mm / 2 - 1
    if not math.isfinite(half):
        return 0.0
    return 1.0 if half <= 1 else half - math.sqrt(half * half - 1)

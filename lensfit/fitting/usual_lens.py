"""What is known of any lens before its photographs are seen: its entrance pupil.

The pupil lies near that of a thin lens, farther ahead in lenses that are shorter than
the room which a camera needs behind them, and farther back in long ones, which are made
shorter than they are long. Of 13 published designs of 14 to 200 mm, from telephoto to
retrofocus, it is within 1.5 of the widths below.

Chief rays of steeper field angles cross the axis elsewhere
(`lensfit.optics.pupil_walk`). Traced through sixteen published designs, f/1.1 to f/5,
to 17 degrees off axis, the pupil walks by

    -0.7 f / N^2

to .15 focal lengths rms, N being the widest f-number: fast lenses have strong glass in
front of the stop. Of a retrofocus lens of 100 degrees it walks .25 more; a telephoto
lens may be far from that (-2.8 of one at f/5.6).
"""

import math
from typing import NamedTuple

_PUPIL_MM = 70.0
_PUPIL_FOCAL_LENGTHS = 0.7
_RETROFOCUS_BELOW_MM, _RETROFOCUS_SLOPE = 50.0, 1.5
_TELEPHOTO_BEYOND_MM, _TELEPHOTO_SLOPE = 100.0, 2.0
_WALK = -0.7
"""Times the square of the f-number, in focal lengths."""
_WALK_DEVIATION, _WALK_DEVIATION_OF_ANY = 0.25, 0.5
"""In focal lengths, of lenses of known and of unknown f-number; a little more than they
scatter: nobody drew them at random."""


class KnownPupil(NamedTuple):
    """The entrance pupil in front of the sensor, before photographs are seen.

    Attributes
    ----------
    offset_mm, standard_deviation_mm : Gaussian.
    common_deviation_mm : What other states of the lens, which told it, have in common.
    measured : Whether photographs of another focus distance measured it.
    """

    offset_mm: float
    standard_deviation_mm: float
    common_deviation_mm: float = 0.0
    measured: bool = False


class KnownWalk(NamedTuple):
    """How the entrance pupil moves with field angle, before photographs are seen.

    Attributes
    ----------
    walk_mm, standard_deviation_mm : Towards the scene, per squared sine of the angle.
    common_deviation_mm, measured : As of `KnownPupil`.
    """

    walk_mm: float
    standard_deviation_mm: float
    common_deviation_mm: float = 0.0
    measured: bool = False


class KnownPerspective(NamedTuple):
    """Where the chief rays of a lens cross its axis; no walk behind cylinders."""

    pupil: KnownPupil
    walk: KnownWalk


def usual_pupil(focal_length_mm: float) -> KnownPupil:
    """The entrance pupil of lenses of this focal length."""
    short_mm = max(_RETROFOCUS_BELOW_MM - focal_length_mm, 0.0)
    long_mm = max(focal_length_mm - _TELEPHOTO_BEYOND_MM, 0.0)
    width_mm = math.hypot(_PUPIL_MM, _PUPIL_FOCAL_LENGTHS * focal_length_mm)
    offset_mm = focal_length_mm + _RETROFOCUS_SLOPE * short_mm
    return KnownPupil(offset_mm - _TELEPHOTO_SLOPE * long_mm, width_mm)


def usual_walk(focal_length_mm: float, widest_f_number: float | None) -> KnownWalk:
    """The walk of lenses as fast as this one; None where nobody said how fast it is."""
    if widest_f_number is None:
        return KnownWalk(0.0, _WALK_DEVIATION_OF_ANY * focal_length_mm)
    walk_mm = _WALK * focal_length_mm / widest_f_number**2
    return KnownWalk(walk_mm, _WALK_DEVIATION * focal_length_mm)


def magnification_at(focal_length_mm: float, focus_distance_mm: float) -> float:
    """Image over object size of a thin lens focused that far from the sensor; 1 where
    it cannot be focused so near.

    From s = f (2 + m + 1 / m).
    """
    half = focus_distance_mm / focal_length_mm / 2 - 1
    if not math.isfinite(half):
        return 0.0
    return 1.0 if half <= 1 else half - math.sqrt(half * half - 1)

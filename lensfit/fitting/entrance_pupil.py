"""The entrance pupil: its position, and its shift along the axis with field angle.

The entrance pupil is the centre of perspective; a tape measure counts from the sensor.
A chart photographed at two tilts determines the principal distance, and with it the
distance of the chart from the pupil. A stated focal length, together with the size of
the image, does so to a few percent. If the chart's distance from the sensor was
measured as well, the difference is the position of the pupil: far in front of the
sensor in a retrofocus lens, close to it in a telephoto lens.

The pupil shifts along the axis with field angle (pupil aberration,
`lensfit.optics.projection`). A tilted chart is near on one side of the frame and far
on the other, so that this shift causes a measurable parallax.

Both are parameters of the fit of every state, with the values of usual lenses as a
prior (`lensfit.fitting.usual_lens`). They are properties of the elements in front of
the stop and therefore shared by the states of one focal length, except that the pupil
moves with focus by some millimetres: as far as the lens, if the whole lens moves.
"""

import math
from typing import NamedTuple

from lensfit.fitting.chief_ray import ChiefRayFit
from lensfit.fitting.uncertainty import Uncertainty
from lensfit.fitting.usual_lens import (
    KnownPerspective,
    KnownPupil,
    KnownPupilShift,
    magnification_at,
    next_order_of_pupil_shift_mm,
    usual_pupil,
    usual_pupil_shift,
)

_MEASURED_PUPIL, _MEASURED_PUPIL_SHIFT = 0.25, 0.5
"""Shares of the prior width of usual lenses; a value with a larger standard deviation
counts as assumed, not as measured."""
_LEAST_MOTION_MM = 0.3
_MOTION = 2.0
"""Standard deviation of the motion with focus, in units of f m: the pupil of a 100 mm
lens with floating elements moves four times as far."""
_PUPIL_SHIFT_WITH_FOCUS = 0.01
"""In focal lengths: the shift with field angle of traced lenses changes by less between
focus distances."""
_AGREES = 1.0
"""Difference, in standard deviations, below which a fitted shift is kept: a new fit
for less would change the lens by chance alone."""


class EntrancePupil(NamedTuple):
    """The centre of perspective of a lens.

    Attributes
    ----------
    offset_mm : In front of the sensor; negative behind it.
    measured : Whether photographs and stated values determine it; otherwise it is
        close to that of usual lenses.
    standard_deviation_mm : Of the offset.
    """

    offset_mm: float
    measured: bool
    standard_deviation_mm: float = float("inf")


class FittedPupilShift(NamedTuple):
    """Shift of the entrance pupil towards the scene, per squared sine of the field
    angle (`optics.projection`)."""

    shift_mm: float
    standard_deviation_mm: float
    measured: bool = True


def entrance_pupil(geometry: ChiefRayFit, uncertainty: Uncertainty) -> EntrancePupil:
    """The entrance pupil of a fitted state."""
    known = geometry.facts.perspective.pupil
    offset_mm, deviation_mm = _fitted_mm(geometry, uncertainty, "pupil_offset")
    usual_mm = usual_pupil(geometry.facts.focal_length_mm).standard_deviation_mm
    measured = known.measured or deviation_mm < _MEASURED_PUPIL * usual_mm
    return EntrancePupil(offset_mm, measured, deviation_mm)


def fitted_pupil_shift(
    geometry: ChiefRayFit, uncertainty: Uncertainty
) -> FittedPupilShift | None:
    """Shift of the entrance pupil with field angle, of a fitted state.

    None for anamorphic lenses, whose two sections have different pupils; and where the
    photographs do not determine it and no f-number or no distance was stated, because
    the map could then not be transferred to other distances.
    """
    views, facts = geometry.takes, geometry.facts
    if geometry.adjustment.layout.anamorphic:
        return None
    known = facts.perspective.pupil_shift
    shift_mm, deviation_mm = _fitted_mm(geometry, uncertainty, "pupil_shift")
    usual_mm = usual_pupil_shift(
        facts.focal_length_mm, _widest(views), views[0].corner_mm
    ).standard_deviation_mm
    measured = known.measured or deviation_mm < _MEASURED_PUPIL_SHIFT * usual_mm
    distances = any(view.target_distance_mm is not None for view in views)
    if not measured and (_widest(views) is None or not distances):
        return None
    return FittedPupilShift(shift_mm, deviation_mm, measured)


def _widest(views) -> float | None:
    return min((t.f_number for t in views if t.f_number is not None), default=None)


def _fitted_mm(
    geometry: ChiefRayFit, uncertainty: Uncertainty, block: str
) -> tuple[float, float]:
    """A length along the axis and its standard deviation."""
    adjustment = geometry.adjustment
    unit_mm = float(adjustment.frame.stated_focal_length_mm)
    value = float(adjustment.parameters[adjustment.layout.blocks[block]][0])
    return value * unit_mm, float(uncertainty.deviation(block)[0]) * unit_mm


def perspective_at_other_focus(
    pupil: EntrancePupil,
    pupil_shift: FittedPupilShift | None,
    focal_length_mm: float,
    corner_mm: float,
    known_at_focus_mm: float | None,
    focus_distance_mm: float | None,
) -> KnownPerspective:
    """Prior of the pupil and its shift at another focus distance.

    If the whole lens moves, the pupil moves with it by f m; moving groups inside change
    this motion, which is therefore uncertain. The error of the known values is common
    to all states.

    Parameters
    ----------
    pupil, pupil_shift : Of the state that determined them.
    corner_mm : Of the frame, from its middle.
    known_at_focus_mm, focus_distance_mm : Focus distances of that state and of the new
        one, from the sensor; None if unknown.
    """
    moved_mm = 0.0
    if known_at_focus_mm is not None and focus_distance_mm is not None:
        there, here = (
            magnification_at(focal_length_mm, distance_mm)
            for distance_mm in (known_at_focus_mm, focus_distance_mm)
        )
        moved_mm = focal_length_mm * (here - there)
    known = KnownPupil(
        pupil.offset_mm + moved_mm,
        max(_MOTION * abs(moved_mm), _LEAST_MOTION_MM),
        pupil.standard_deviation_mm,
        pupil.measured,
    )
    if pupil_shift is None:
        usual = usual_pupil_shift(focal_length_mm, None, corner_mm)
        return KnownPerspective(known, usual)
    return KnownPerspective(
        known,
        KnownPupilShift(
            pupil_shift.shift_mm,
            _PUPIL_SHIFT_WITH_FOCUS * focal_length_mm,
            pupil_shift.standard_deviation_mm,
            pupil_shift.measured,
        ),
    )


def perspective_with_pupil_shift(
    geometry: ChiefRayFit,
    pupil_shift: FittedPupilShift | None,
    corrected: FittedPupilShift | None,
) -> KnownPerspective | None:
    """Prior of a state whose pupil shift with field angle was corrected; None if the
    correction is within its standard deviation.

    Parameters
    ----------
    pupil_shift, corrected : As fitted, and with shared errors of the detections allowed
        for.
    """
    if pupil_shift is None or corrected is None:
        return None
    if (
        abs(corrected.shift_mm - pupil_shift.shift_mm)
        < _AGREES * corrected.standard_deviation_mm
    ):
        return None
    focal_mm = geometry.facts.focal_length_mm
    left_mm = next_order_of_pupil_shift_mm(
        corrected.shift_mm, focal_mm, geometry.takes[0].corner_mm
    )
    deviation_mm = math.hypot(corrected.standard_deviation_mm, left_mm)
    return geometry.facts.perspective._replace(
        pupil_shift=KnownPupilShift(
            corrected.shift_mm,
            _PUPIL_SHIFT_WITH_FOCUS * focal_mm,
            deviation_mm,
            corrected.measured,
        )
    )

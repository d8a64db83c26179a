"""Where chief rays cross the axis: what was stated and tilted charts tell together.

Chief rays meet in the entrance pupil, and perspective counts from there; a tape measure
counts from the sensor. A chart that is photographed at two tilts fixes the principal
distance, and with it how far the chart is from the pupil; a stated focal length does
so to a few percent, together with the size of the picture. Where the chart's distance
from the sensor was measured too, the difference is the pupil's place: far in front of
the sensor in a retrofocus lens, close to it in a telephoto lens.

A tilted chart is near on one side of the frame and far on the other, and a pupil that
walks along the axis with field angle has another parallax at each.

Both are parameters of the fit of every state, which stay near those of usual lenses
(`lensfit.fitting.usual_lens`) where nothing else tells them. They belong to the glass
in front of the stop: states of one focal length share them, but that the pupil moves
with focus by millimetres, as far as the lens where all of it moves.
"""

import math
from typing import NamedTuple

from lensfit.fitting.chief_ray import ChiefRayFit
from lensfit.fitting.uncertainty import Uncertainty
from lensfit.fitting.usual_lens import (
    KnownPerspective,
    KnownPupil,
    KnownWalk,
    magnification_at,
    usual_pupil,
    usual_walk,
)

_MEASURED_PUPIL, _MEASURED_WALK = 0.25, 0.5
"""Of the width of usual lenses: what is known no better counts as assumed."""
_LEAST_MOTION_MM = 0.3
_MOTION = 2.0
"""Of f m, how unsure the motion with focus is: a 100 mm lens with floating elements
moves its pupil four times as far."""
_WALK_WITH_FOCUS = 0.01
"""In focal lengths: the walk of traced lenses changes by less between focus states."""

_WALK_HIGHER_ORDERS = 0.15
"""Share of a walk by which its slope in sin^2 is off where sin^4 matters: of a 50 mm
f/1.4 and of a 14 mm lens of 100 degrees, traced, a sixth and a tenth."""
_AGREES = 1.0
"""Standard deviations within which a fitted walk stays as it was: to solve anew for
less changes a lens by chance alone."""


class EntrancePupil(NamedTuple):
    """The centre of perspective of a lens.

    Attributes
    ----------
    offset_mm : In front of the sensor; negative behind it.
    measured : Whether photographs, with what was stated, determine it; else it is near
        that of usual lenses.
    standard_deviation_mm : Of the offset.
    """

    offset_mm: float
    measured: bool
    standard_deviation_mm: float = float("inf")


class FittedWalk(NamedTuple):
    """Towards the scene, per squared sine of the field angle (`optics.pupil_walk`)."""

    walk_mm: float
    standard_deviation_mm: float
    measured: bool = True


def entrance_pupil(geometry: ChiefRayFit, uncertainty: Uncertainty) -> EntrancePupil:
    """The entrance pupil that a state was fitted with."""
    known = geometry.facts.perspective.pupil
    offset_mm, deviation_mm = _fitted_mm(geometry, uncertainty, "pupil_offset")
    usual_mm = usual_pupil(geometry.facts.focal_length_mm).standard_deviation_mm
    measured = known.measured or deviation_mm < _MEASURED_PUPIL * usual_mm
    return EntrancePupil(offset_mm, measured, deviation_mm)


def pupil_walk(geometry: ChiefRayFit, uncertainty: Uncertainty) -> FittedWalk | None:
    """The walk that a state was fitted with.

    None where photographs do not show it and no f-number or distance was stated, since
    nothing could be told of other distances then, and behind cylinders, whose sections
    have a pupil each.
    """
    takes, facts = geometry.takes, geometry.facts
    if geometry.adjustment.layout.anamorphic:
        return None
    known = facts.perspective.walk
    walk_mm, deviation_mm = _fitted_mm(geometry, uncertainty, "pupil_walk")
    usual_mm = usual_walk(facts.focal_length_mm, _widest(takes)).standard_deviation_mm
    measured = known.measured or deviation_mm < _MEASURED_WALK * usual_mm
    distances = any(take.target_distance_mm is not None for take in takes)
    if not measured and (_widest(takes) is None or not distances):
        return None
    return FittedWalk(walk_mm, deviation_mm, measured)


def _widest(takes) -> float | None:
    return min((t.f_number for t in takes if t.f_number is not None), default=None)


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
    walk: FittedWalk | None,
    focal_length_mm: float,
    told_at_mm: float | None,
    focus_distance_mm: float | None,
) -> KnownPerspective:
    """Pupil and walk at another focus distance, before its photographs are seen.

    Where the whole lens moves, the pupil moves along by f m; groups inside move it
    farther, less or the other way. The error of what was told is common to all states:
    only the motion is left open.

    Parameters
    ----------
    pupil, walk : As one state told them.
    told_at_mm, focus_distance_mm : From the sensor; None where nobody said.
    """
    moved_mm = 0.0
    if told_at_mm is not None and focus_distance_mm is not None:
        there, here = (
            magnification_at(focal_length_mm, distance_mm)
            for distance_mm in (told_at_mm, focus_distance_mm)
        )
        moved_mm = focal_length_mm * (here - there)
    known = KnownPupil(
        pupil.offset_mm + moved_mm,
        max(_MOTION * abs(moved_mm), _LEAST_MOTION_MM),
        pupil.standard_deviation_mm,
        pupil.measured,
    )
    if walk is None:
        return KnownPerspective(known, usual_walk(focal_length_mm, None))
    return KnownPerspective(
        known,
        KnownWalk(
            walk.walk_mm,
            _WALK_WITH_FOCUS * focal_length_mm,
            walk.standard_deviation_mm,
            walk.measured,
        ),
    )


def perspective_with_walk(
    geometry: ChiefRayFit, walk: FittedWalk | None, surer: FittedWalk | None
) -> KnownPerspective | None:
    """What is known of a state whose walk is known better than by its own fit; None
    where both agree.

    Parameters
    ----------
    walk, surer : As it was fitted, and as it is known.
    """
    if walk is None or surer is None:
        return None
    if abs(surer.walk_mm - walk.walk_mm) < _AGREES * surer.standard_deviation_mm:
        return None
    deviation_mm = math.hypot(
        surer.standard_deviation_mm, _WALK_HIGHER_ORDERS * surer.walk_mm
    )
    return geometry.facts.perspective._replace(
        walk=KnownWalk(
            surer.walk_mm,
            _WALK_WITH_FOCUS * geometry.facts.focal_length_mm,
            deviation_mm,
            surer.measured,
        )
    )

"""How far the entrance pupil walks with field angle, as tilted charts show it.

A tilted chart is near on one side of the frame and far on the other, and a pupil that
walks has another parallax at each (`lensfit.optics.pupil_walk`). A few degrees of tilt
say little, so what is known of lenses is joined to what the photographs say: traced
through eight published designs the pupil walks by -.8 to .2 focal lengths, and by -2.8
in a tele. All states of a focal length share the walk: it belongs to the glass in front
of the stop.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from lensfit.fit.chief_ray import ChiefRayFit
from lensfit.fit.uncertainty import Uncertainty

_OF_LENSES = 0.5
"""Deviation of the walk of published lenses about zero, in focal lengths."""
_LEAST_LEARNT = 2.0
"""Of that: walks that are known no better are none."""


class MeasuredWalk(NamedTuple):
    """Towards the scene, per squared sine of the field angle."""

    walk_mm: float
    standard_deviation_mm: float


def measured_walk(
    geometry: ChiefRayFit, uncertainty: Uncertainty
) -> MeasuredWalk | None:
    """The walk that the takes of one state show; None where they show none."""
    adjustment = geometry.adjustment
    where = adjustment.layout.blocks["pupil_walk"]
    if not adjustment.prior.free[where].any():
        return None
    share = float(uncertainty.deviation("pupil_walk")[0])
    if share > _LEAST_LEARNT * _OF_LENSES:
        return None
    unit_mm = float(adjustment.frame.stated_focal_length_mm)
    value = float(adjustment.parameters[where][0])
    # Here, since the deviation counts what the fit does not know: errors that all
    # marks of a photograph share.
    believed = 1 / (1 + (share / _OF_LENSES) ** 2)
    return MeasuredWalk(value * believed * unit_mm, share * believed**0.5 * unit_mm)


def shared_walk(walks: Iterable[MeasuredWalk | None]) -> MeasuredWalk | None:
    """What states of one focal length say together: the weighted mean. None where none
    of them says anything."""
    known = [walk for walk in walks if walk is not None]
    if not known:
        return None
    walk_mm, deviation_mm = np.array(known).T
    precision = deviation_mm**-2.0
    mean_mm = np.sum(precision * walk_mm) / np.sum(precision)
    return MeasuredWalk(float(mean_mm), float(np.sum(precision) ** -0.5))

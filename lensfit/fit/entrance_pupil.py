"""Where the entrance pupil is: what a tape measure and a tilted chart say together.

Chief rays meet in the entrance pupil, and perspective counts from there; a tape measure
counts from the sensor. A chart that is photographed at two tilts fixes the principal
distance, and with it how far the chart is from the pupil. Where its distance from the
sensor was measured too, the difference is the pupil's place: far in front of the sensor
in a retrofocus lens, close to it in a telephoto lens. Otherwise it is assumed to be one
principal distance in front of the sensor, as in a thin lens.

Tilted charts also say how the pupil walks along the axis with field angle
(`lensfit.fit.pupil_walk`); that, too, is one number that all states share.

Takes of one focal length share the pupil: it moves with focus by millimetres.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from lensfit.fit.adjust import fitted_depths_mm
from lensfit.fit.chief_ray import ChiefRayFit
from lensfit.fit.uncertainty import Uncertainty

_FARTHEST = 0.25
"""Of the chart's distance; a pupil beyond, or as far behind the sensor, is an error of
the tape measure or of the pitch."""


class EntrancePupil(NamedTuple):
    """The centre of perspective of a lens.

    Attributes
    ----------
    offset_mm : In front of the sensor; negative behind it.
    measured : Whether photographs say so; else it is assumed.
    """

    offset_mm: float
    measured: bool


def entrance_pupil(
    geometry: ChiefRayFit,
    uncertainty: Uncertainty,
    principal_distance_mm: float,
    known_mm: float | None,
) -> EntrancePupil:
    """The entrance pupil of a state: as its own photographs measure it, else as others
    of its focal length did, else as in a thin lens.

    Parameters
    ----------
    geometry, uncertainty, principal_distance_mm : Of the state.
    known_mm : What other states say (`shared_pupil_mm`).
    """
    offset_mm = _measured_offset_mm(geometry, uncertainty)
    if offset_mm is None:
        offset_mm = known_mm
    if offset_mm is None:
        return EntrancePupil(principal_distance_mm, measured=False)
    return EntrancePupil(offset_mm, measured=True)


def shared_pupil_mm(pupils: Iterable[EntrancePupil]) -> float | None:
    """Where states of one focal length measured the entrance pupil, mm in front of the
    sensor: the median. None where none of them did."""
    offsets_mm = [pupil.offset_mm for pupil in pupils if pupil.measured]
    return float(np.median(offsets_mm)) if offsets_mm else None


def _measured_offset_mm(
    geometry: ChiefRayFit, uncertainty: Uncertainty
) -> float | None:
    """Where a fit found the entrance pupil; None where it is not seen.

    It is seen where the views tilt, distances were stated, and the error of the chart's
    depth is less than that of the assumption, which is of the order of the principal
    distance. Behind cylinders each section has a pupil of its own, and none is told.
    """
    takes = geometry.takes
    if not geometry.focal_length_free or any(take.anamorphic for take in takes):
        return None
    depths_mm = fitted_depths_mm(geometry.adjustment)
    stated = [
        (take.target_distance_mm, depth_mm)
        for take, depth_mm in zip(takes, depths_mm, strict=True)
        if take.target_distance_mm is not None
    ]
    if not stated:
        return None
    offset_mm = float(np.median([said - depth for said, depth in stated]))
    said_mm, depth_mm = np.median(stated, axis=0)
    unsure_mm = depth_mm * float(uncertainty.deviation("focal_length")[0])
    known = unsure_mm < float(geometry.adjustment.frame.stated_focal_length_mm)
    if not known or abs(offset_mm) > _FARTHEST * said_mm:
        return None
    return offset_mm

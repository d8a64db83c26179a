"""How far the entrance pupil walks with field angle: as tilted charts show it, or as in
most lenses.

A tilted chart is near on one side of the frame and far on the other, and a pupil that
walks has another parallax at each (`lensfit.optics.pupil_walk`). A few degrees of tilt
say little, and a chart that faces the camera nothing; what is known of lenses is joined
to what the photographs say. Traced through sixteen published designs, f/1.1 to f/5, to
17 degrees off axis, the pupil walks by

    -0.7 f / N^2

to .15 focal lengths rms, N being the widest f-number: fast lenses have strong glass in
front of the stop. A telephoto lens may be far from that (-2.8 of one at f/5.6). All
states of a focal length share the walk: it belongs to the glass in front of the stop.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lensfit.fit.chief_ray import ChiefRayFit
from lensfit.fit.half_equations import least_fall
from lensfit.fit.priors import LOOSE, release
from lensfit.fit.take import Take
from lensfit.fit.uncertainty import Uncertainty, uncertainty_of

_OF_LENSES = -0.7
"""Walk of published lenses times the square of their f-number, in focal lengths."""
_OF_LENSES_DEVIATION = 0.2
"""In focal lengths, a little more than they scatter: nobody drew them at random."""
_LEAST_LEARNT = 1.0
"""Focal lengths: walks that are known no better are none."""


class KnownWalk(NamedTuple):
    """Towards the scene, per squared sine of the field angle.

    `measured` tells whether photographs of this lens had a say.
    """

    walk_mm: float
    standard_deviation_mm: float
    measured: bool = True


def measured_walk(geometry: ChiefRayFit, uncertainty: Uncertainty) -> KnownWalk | None:
    """The walk that the takes of one state show; None where they show none.

    Where they would have shown that of most lenses and did not, the pupil stands still.

    Parameters
    ----------
    uncertainty : Of the fit. It counts what the fit does not know: errors that all
        marks of a photograph share.
    """
    adjustment = geometry.adjustment
    where = adjustment.layout.blocks["pupil_walk"]
    if adjustment.prior.free[where].any():
        share, most = _share(uncertainty), _LEAST_LEARNT
    elif geometry.walk_shows:
        share, most = _share_left_out(geometry), _OF_LENSES_DEVIATION
    else:
        return None
    if share > most:
        return None
    unit_mm = float(adjustment.frame.stated_focal_length_mm)
    value = float(adjustment.parameters[where][0])
    return KnownWalk(value * unit_mm, share * unit_mm)


def _share(uncertainty: Uncertainty) -> float:
    """Standard deviation of the walk, in focal lengths."""
    return float(uncertainty.deviation("pupil_walk")[0])


def _share_left_out(geometry: ChiefRayFit) -> float:
    """The same of a walk that was left out of the fit: what is too small to see is
    known no better than the least that would have been seen."""
    adjustment = geometry.adjustment
    where = adjustment.layout.blocks["pupil_walk"]
    freed = release(adjustment.prior, where, LOOSE["pupil_walk"])
    known = uncertainty_of(replace(adjustment, prior=freed), geometry.takes)
    return _share(known) * (1 + least_fall(adjustment) ** 0.5)


def usual_walk(takes: Sequence[Take]) -> KnownWalk | None:
    """That of most lenses as fast as these takes of one focal length say theirs is.

    None where no f-number or distance was stated, since nothing could be told of other
    distances then, and behind cylinders, whose sections have a pupil each.
    """
    numbers = [take.f_number for take in takes if take.f_number is not None]
    distances = [take for take in takes if take.target_distance_mm is not None]
    if not numbers or not distances or any(take.anamorphic for take in takes):
        return None
    focal_mm = takes[0].focal_length_mm
    return KnownWalk(
        _OF_LENSES * focal_mm / min(numbers) ** 2,
        _OF_LENSES_DEVIATION * focal_mm,
        measured=False,
    )


def shared_walk(
    walks: Iterable[KnownWalk | None], usual: KnownWalk | None = None
) -> KnownWalk | None:
    """What states of one focal length say together, and what is usual: the weighted
    mean. None where none of them says anything and nothing is usual."""
    measured = [walk for walk in walks if walk is not None]
    known = measured if usual is None else [*measured, usual]
    if not known:
        return None
    walk_mm = np.array([walk.walk_mm for walk in known])
    precision = np.array([walk.standard_deviation_mm for walk in known]) ** -2.0
    return KnownWalk(
        float(np.sum(precision * walk_mm) / np.sum(precision)),
        float(np.sum(precision) ** -0.5),
        measured=bool(measured),
    )

"""The fit of one lens state: one focal length at one focus distance.

All views of a state share one chief-ray geometry and one lateral colour; fall-off is
fitted separately for each f-number.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import jax
import numpy as np

from lensfit.fitting.chart_view import View
from lensfit.fitting.chief_ray import ChiefRayFit, fit_chief_ray
from lensfit.fitting.colour.lateral_colour import ChannelColour, Views, fit_colours
from lensfit.fitting.decentring import DecentringTerms
from lensfit.fitting.entrance_pupil import (
    EntrancePupil,
    FittedPupilShift,
    entrance_pupil,
    fitted_pupil_shift,
)
from lensfit.fitting.fall_off.illumination import FallOffFit, fit_illumination
from lensfit.fitting.geometry import compiled_distortion_of
from lensfit.fitting.statements import Statement
from lensfit.fitting.uncertainty import Uncertainty, uncertainty_of
from lensfit.fitting.usual_lens import KnownPerspective
from lensfit.optics.distortion import Distortion, without_idle_degrees
from lensfit.optics.projection import BaseProjection
from lensfit.progress import Progress, silent

_LEAST_PX = 1e-4
"""Lower bound of a held-out error, so that its logarithm exists; no photograph is
fitted as well as this."""
_DECISIVE = 1.5
"""Held-out error at chief rays over that at centroids. Of fourteen lenses photographed
with holes one has more at one focus; of a shoot of checkers, whose chief rays came out
.16 px off, two."""
_OFF_LINE, _STEEPEST = 0.01, 8.0
"""Of focal lengths over focus: how far a state may lie off their line, and the relative
change, times focus distance over focal length; front groups of zooms make 3 to 5."""


@dataclass(frozen=True, eq=False)
class LensState:
    """Everything measured at one focal length and focus distance.

    Attributes
    ----------
    focal_length_mm, focus_distance_mm : As engraved on the barrel.
    geometry : The chief-ray fit and the views it was made from.
    distortion : The lens model of that fit.
    uncertainty : Covariance of the parameters of that fit.
    pupil : Position of the entrance pupil.
    fall_off : One fit for each f-number.
    colour : Red and blue relative to green (`with_colour`); empty for monochrome
        photographs.
    pupil_shift : Of the entrance pupil with field angle; None if it was not determined.
    """

    focal_length_mm: float
    focus_distance_mm: float | None
    geometry: ChiefRayFit
    distortion: Distortion
    uncertainty: Uncertainty
    pupil: EntrancePupil
    fall_off: list[FallOffFit]
    colour: dict[str, ChannelColour] = field(default_factory=dict)
    pupil_shift: FittedPupilShift | None = None


def fit_state(
    group: list[View],
    progress: Progress = silent,
    *,
    all_views: list[View],
    base: BaseProjection | None = None,
    perspective: KnownPerspective | None = None,
    known_decentring: DecentringTerms | None = None,
) -> LensState:
    """Fit geometry and fall-off of one state; lateral colour follows in `with_colour`.

    Parameters
    ----------
    group : Views of this focal length and focus distance.
    all_views : Views of all states of the lens.
    base : Ideal projection of the states that were fitted before, so that states can be
        interpolated; None selects the projection with the smallest residuals.
    perspective : Entrance pupil and its shift with field angle, as measured at another
        focus distance.
    known_decentring : Decentring terms, as measured at another focus distance.

    Raises
    ------
    FitError : The detections do not determine a lens, or contradict what was stated.
    """
    geometry = fit_chief_ray(
        group,
        progress,
        all_views=all_views,
        base=base,
        perspective=perspective,
        known_decentring=known_decentring,
    )
    adjustment = geometry.adjustment
    layout = adjustment.layout
    shared = adjustment.parameters[: layout.shared]
    lens = compiled_distortion_of(shared, layout, adjustment.frame)
    # On the host, because indexing a device array would compile a program.
    distortion = without_idle_degrees(jax.device_get(lens))
    centre = np.asarray(distortion.principal_point_mm)
    uncertainty = uncertainty_of(adjustment, geometry.takes)
    return LensState(
        focal_length_mm=group[0].focal_length_mm,
        focus_distance_mm=group[0].focus_distance_mm,
        geometry=geometry,
        distortion=distortion,
        uncertainty=uncertainty,
        pupil=entrance_pupil(geometry, uncertainty),
        fall_off=fit_illumination(geometry.takes, adjustment, centre),
        pupil_shift=fitted_pupil_shift(geometry, uncertainty),
    )


def with_colour(states: Sequence[LensState]) -> list[LensState]:
    """The states with their lateral colour, fitted jointly for each focal length."""
    found: dict[int, dict[str, ChannelColour]] = {}
    for mine in states_by_focal_length(states).values():
        seen = [
            Views(
                state.geometry.takes,
                np.asarray(state.distortion.principal_point_mm),
                float(state.distortion.reference_radius_mm),
            )
            for state in mine
        ]
        found |= zip(map(id, mine), fit_colours(seen), strict=True)
    return [replace(state, colour=found[id(state)]) for state in states]


def more_accurate_state(after: LensState, before: Iterable[LensState]) -> LensState:
    """Of an anamorphic state, the fit with the smaller held-out error.

    Cylinders leave errors of a tenth of the blur in the wavefront, and detections that
    were moved from centroids to chief rays inherit these errors. Spherical lenses
    always use the fit to chief rays.

    Parameters
    ----------
    after : Fitted to chief rays.
    before : States fitted to centroids, of any focal length and focus distance.
    """
    if not any(view.anamorphic for view in after.geometry.takes):
        return after
    same = _at_setting_of(after, before)
    return min([after, *same], key=lambda one: one.geometry.held_out_rms_px)


def states_worse_at_chief_rays(
    after: Iterable[LensState], before: Sequence[LensState]
) -> tuple[LensState, ...]:
    """States whose held-out error is decisively larger where detections were moved from
    centroids to chief rays: there the wavefront predicts centroid biases worse than
    none at all would.

    Parameters
    ----------
    after, before : Fitted to chief rays, and to centroids.
    """

    def is_worse(moved: LensState) -> bool:
        most_px = moved.geometry.held_out_rms_px / _DECISIVE
        same = _at_setting_of(moved, before)
        return any(one.geometry.held_out_rms_px < most_px for one in same)

    return tuple(one for one in after if is_worse(one))


def _at_setting_of(state: LensState, others: Iterable[LensState]) -> list[LensState]:
    """Those of its focal length and focus distance."""
    setting = state.focal_length_mm, state.focus_distance_mm
    return [
        one for one in others if (one.focal_length_mm, one.focus_distance_mm) == setting
    ]


def mean_held_out_rms_px(states: Iterable[LensState]) -> float:
    """Held-out error of several states: the geometric mean over their photographs, so
    that sharp and blurred photographs count alike.
    """
    each = [px for one in states for px in one.geometry.held_out_rms_px_of_take]
    return float(np.exp(np.mean(np.log(np.maximum(each, _LEAST_PX)))))


def engraved_focal_lengths(states: Iterable[LensState]) -> dict[float, Statement]:
    """The focal length that every engraved one was found to be.

    A barrel says the focal length of the lens focused at infinity. Where elements move
    against each other it changes with focus, in proportion to vergence: a zoom that
    focuses by its front group had 77.5 mm at 2.9 m and 80.9 at 2 m for 71.7. So states
    that lie on such a line are extrapolated to infinity, and what agrees better counts,
    that or the state in the middle of all of them, since one may be ill. An anamorphic
    lens has two focal lengths, and squeezes more or less than engraved as it focuses:
    of these there is none.
    """
    found = {}
    for focal_mm, mine in states_by_focal_length(states).items():
        known = [
            (state.focus_distance_mm, one)
            for state in mine
            for one in state.geometry.statements
            if one.quantity == "focal_length"
        ]
        if known and not any(t.anamorphic for s in mine for t in s.geometry.takes):
            found[focal_mm] = _engraved_focal_length(known)
    return found


def _engraved_focal_length(known: list[tuple[float | None, Statement]]) -> Statement:
    """Of one focal length, from its focus distances."""
    ordered = sorted((one for _, one in known), key=lambda one: one.residual_widths)
    middle = ordered[len(ordered) // 2]
    at = np.array([(1 / mm, s.fitted / s.stated) for mm, s in known if mm])
    if len(at) < 2 or np.ptp(at[:, 0]) == 0:
        return middle
    slope_mm, ratio = np.polyfit(at[:, 0], at[:, 1], 1).tolist()
    off = np.abs(slope_mm * at[:, 0] + ratio - at[:, 1]).max()
    if off > _OFF_LINE or abs(slope_mm) > _STEEPEST * middle.stated:
        return middle
    at_infinity = middle._replace(fitted=ratio * middle.stated)
    return min(middle, at_infinity, key=lambda one: abs(one.residual_widths))


def states_by_focal_length(states: Iterable[LensState]) -> dict[float, list[LensState]]:
    """The states grouped by focal length, shortest first."""
    found: dict[float, list[LensState]] = {}
    for state in sorted(states, key=lambda one: one.focal_length_mm):
        found.setdefault(state.focal_length_mm, []).append(state)
    return found

"""One state of a lens, a focal length and a focus distance, as its photographs show it.

Takes of one state share their geometry and colour; fall-off belongs to each f-number.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import jax
import numpy as np

from lensfit.fitting.chief_ray import ChiefRayFit, fit_chief_ray
from lensfit.fitting.colour.channel_colour import ChannelColour
from lensfit.fitting.colour.lateral_colour import Views, fit_colours
from lensfit.fitting.decentring import OutOfCentre
from lensfit.fitting.entrance_pupil import (
    EntrancePupil,
    FittedWalk,
    entrance_pupil,
    pupil_walk,
)
from lensfit.fitting.fall_off.fall_off_fit import FallOffFit
from lensfit.fitting.fall_off.illumination import fit_illumination
from lensfit.fitting.geometry import compiled_distortion_of
from lensfit.fitting.take import Take
from lensfit.fitting.uncertainty import Uncertainty, uncertainty_of
from lensfit.fitting.usual_lens import KnownPerspective
from lensfit.optics.base import BaseProjection
from lensfit.optics.distortion import Distortion, without_idle_degrees
from lensfit.progress import Progress, silent

_LEAST_PX = 1e-4
"""Marks that fit better than this, as none do that were photographed, count as this."""


@dataclass(frozen=True, eq=False)
class LensState:
    """Everything measured at one focal length and focus distance.

    Attributes
    ----------
    focal_length_mm, focus_distance_mm : As on the barrel.
    geometry : The chief-ray fit and its marks.
    distortion : Its lens.
    uncertainty : Of its parameters.
    pupil : Where its entrance pupil is.
    fall_off : One for each f-number.
    colour : Red and blue against green (`with_colour`); empty for monochrome
        photographs.
    walk : How the entrance pupil moves with field angle; None where nobody knows.
    """

    focal_length_mm: float
    focus_distance_mm: float | None
    geometry: ChiefRayFit
    distortion: Distortion
    uncertainty: Uncertainty
    pupil: EntrancePupil
    fall_off: list[FallOffFit]
    colour: dict[str, ChannelColour] = field(default_factory=dict)
    walk: FittedWalk | None = None


def fit_state(
    group: list[Take],
    progress: Progress = silent,
    *,
    shown: list[Take],
    base: BaseProjection | None = None,
    perspective: KnownPerspective | None = None,
    told: OutOfCentre | None = None,
) -> LensState:
    """Fit the takes of one state, but for its colour.

    Parameters
    ----------
    group : Of one focal length and focus distance.
    shown : Of all states of the lens.
    base : Ideal projection of the states before, so that states can be interpolated;
        None for the one that suits the marks best.
    perspective : Entrance pupil and its walk, as another state told them.
    told : What other states told of elements out of centre.

    Raises
    ------
    FitError : The marks do not determine a lens, or contradict what was stated.
    """
    geometry = fit_chief_ray(
        group, progress, shown=shown, base=base, perspective=perspective, told=told
    )
    adjustment = geometry.adjustment
    layout = adjustment.layout
    shared = adjustment.parameters[: layout.shared]
    lens = compiled_distortion_of(shared, layout, adjustment.frame)
    # On the host, where taking an array apart compiles nothing.
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
        walk=pupil_walk(geometry, uncertainty),
    )


def with_colour(states: Sequence[LensState]) -> list[LensState]:
    """The states with their lateral colour, found together for each focal length."""
    found: dict[int, dict[str, ChannelColour]] = {}
    for mine in by_focal_length(states).values():
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


def better_told(after: LensState, before: Iterable[LensState]) -> LensState:
    """The state of marks moved to chief rays (`after`), or that of their centroids.

    Behind cylinders the wavefront leaves errors of a tenth of the blur, and moved marks
    share them; the state that predicts its marks better stays.
    """
    if not any(take.anamorphic for take in after.geometry.takes):
        return after
    same = [
        one
        for one in before
        if one.focal_length_mm == after.focal_length_mm
        and one.focus_distance_mm == after.focus_distance_mm
    ]
    return min([after, *same], key=lambda one: one.geometry.held_out_rms_px)


def left_px(states: Iterable[LensState]) -> float:
    """What states leave of marks held out: the geometric mean over their photographs,
    so that each has its say, the blurred and the sharp.
    """
    each = [px for one in states for px in one.geometry.held_out_rms_px_of_take]
    return float(np.exp(np.mean(np.log(np.maximum(each, _LEAST_PX)))))


def by_focal_length(states: Iterable[LensState]) -> dict[float, list[LensState]]:
    """The states of every focal length, shortest first."""
    found: dict[float, list[LensState]] = {}
    for state in sorted(states, key=lambda one: one.focal_length_mm):
        found.setdefault(state.focal_length_mm, []).append(state)
    return found

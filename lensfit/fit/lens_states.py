"""All states of a lens: one fit per focal length and focus distance (`lens_state`).

States of one focal length share the entrance pupil that any of them measured, and the
wavefront, which is fitted to the shape of their dots. It says where chief rays land, as
opposed to centroids, and geometry and colour are then fitted again to those.
"""

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from lensfit.errors import FitError
from lensfit.fit.entrance_pupil import shared_pupil_mm
from lensfit.fit.illumination import FallOffFit
from lensfit.fit.lens_state import LensState, better_told, fit_state
from lensfit.fit.pupil_walk import shared_walk
from lensfit.fit.take import Take, grouped
from lensfit.fit.wavefront.effort import Effort
from lensfit.fit.wavefront.fit import WavefrontFit, fit_wavefront
from lensfit.fit.wavefront.place import placed
from lensfit.fit.wavefront.shown import LARGEST_HOLE_CELLS, Shown, hole_cells
from lensfit.fit.wavefront.uncertainty import parameter_moves
from lensfit.progress import Progress, silent


@dataclass(frozen=True, eq=False)
class Fitted:
    """What came of all takes.

    Attributes
    ----------
    states : Those that could be fitted.
    failed : Why others could not, by take name.
    wavefronts : Of the dots' shape, by focal length.
    without_shape : Why others were not fitted though dots were photographed, by focal
        length; what to do about it included.
    seconds : Of the fits of shape.
    """

    states: tuple[LensState, ...]
    failed: dict[str, FitError]
    wavefronts: dict[float, WavefrontFit] = field(default_factory=dict)
    without_shape: dict[float, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each thing the photographer should know."""
        return tuple(
            f"the blur at {focal_mm:g} mm was not measured: {reason}"
            for focal_mm, reason in self.without_shape.items()
        )


def fit(
    takes: list[Take],
    progress: Progress = silent,
    *,
    effort: Effort = Effort.NORMAL,
    allowed: Collection[str] | None = None,
) -> Fitted:
    """Fit a lens to the marks of its photographs.

    Parameters
    ----------
    takes : One for each photograph; any number of focal lengths, focus distances and
        f-numbers of one lens.
    progress : Told how far it is.
    effort : Speed against error of the fit of the dots' shape.
    allowed : Families of the wavefront that may be free (`fit_wavefront`).

    Raises
    ------
    FitError : No state could be fitted; otherwise failures come back with the rest.
        Or some takes of a focal length state their focus distance and others do not.
    """
    _require_like_focus(takes)
    states, failed = _fit_sharing_pupils(takes, progress)
    if not states:
        raise next(iter(failed.values()), FitError("there are no photographs to fit"))
    began = time.perf_counter()
    wavefronts, without = _fit_wavefronts(states, progress, effort, allowed)
    if not wavefronts:
        return Fitted(_sharing_walks(states), failed, without_shape=without)
    seconds = {"fit_wavefront": time.perf_counter() - began}
    exact = {
        take.name: take
        for found in wavefronts.values()
        for take in placed(
            found.stage,
            found.gathered,
            parameter_moves(found.stage, found.covariance),
        )
    }
    moved = [exact.get(t.name, t) for t in takes]
    again, failed = _fit_sharing_pupils(moved, progress)
    states = [better_told(state, states) for state in again]
    return Fitted(_sharing_walks(states), failed, wavefronts, without, seconds)


def _sharing_walks(states: list[LensState]) -> tuple[LensState, ...]:
    """Each with the walk of the pupil that all of its focal length show together."""
    walks = {
        focal_mm: shared_walk(state.walk for state in mine)
        for focal_mm, mine in by_focal_length(states).items()
    }
    return tuple(replace(s, walk=walks[s.focal_length_mm]) for s in states)


def by_focal_length(states: Iterable[LensState]) -> dict[float, list[LensState]]:
    """The states of every focal length, shortest first."""
    found: dict[float, list[LensState]] = {}
    for state in sorted(states, key=lambda one: one.focal_length_mm):
        found.setdefault(state.focal_length_mm, []).append(state)
    return found


def _fit_sharing_pupils(
    takes: list[Take], progress: Progress
) -> tuple[list[LensState], dict[str, FitError]]:
    """Every state; those that do not see their entrance pupil with that of the others.

    A pupil that is wrong by some share of the chart's distance scales a state by as
    much. A tilt of few degrees hardly tells it, and another solve would find another
    one: the states that told it stay as they were then.
    """
    states, failed = _fit_states(takes, progress, {}, shown=takes)
    found = {
        focal_mm: shared_pupil_mm(state.pupil for state in mine)
        for focal_mm, mine in by_focal_length(states).items()
    }
    pupils = {focal_mm: mm for focal_mm, mm in found.items() if mm is not None}
    told = [s for s in states if s.pupil.measured or s.focal_length_mm not in pupils]
    names = {take.name for state in told for take in state.geometry.takes}
    groups = grouped(takes)
    others = [t for g in groups if not any(o.name in names for o in g) for t in g]
    again, failed_again = _fit_states(others, progress, pupils, shown=takes, among=told)
    retried = {take.name for take in others}
    failed = {name: why for name, why in failed.items() if name not in retried}
    return _in_order([*told, *again], takes), failed | failed_again


def _in_order(states: list[LensState], takes: list[Take]) -> list[LensState]:
    """As their photographs come."""
    place = {take.name: k for k, take in enumerate(takes)}
    return sorted(states, key=lambda s: min(place[t.name] for t in s.geometry.takes))


def _fit_states(
    takes: list[Take],
    progress: Progress,
    pupils: Mapping[float, float],
    *,
    shown: list[Take],
    among: Sequence[LensState] = (),
) -> tuple[list[LensState], dict[str, FitError]]:
    """Every state by itself, with the entrance pupils that others measured.

    Parameters
    ----------
    shown : Of all states of the lens.
    among : Other states of the lens.
    """
    states: list[LensState] = []
    failed: dict[str, FitError] = {}
    groups = grouped(takes)
    while groups:
        group = groups.pop(0)
        try:
            others = [*among, *states]
            base = others[0].distortion.base if others else None
            pupil_mm = pupils.get(group[0].focal_length_mm)
            states.append(
                fit_state(group, progress, shown=shown, base=base, pupil_mm=pupil_mm)
            )
        except FitError as error:
            # One photograph that contradicts itself must not cost the others.
            rest = [take for take in group if take.name != error.where]
            at_fault = [take for take in group if take.name == error.where] or group
            failed |= {take.name: error for take in at_fault}
            if at_fault is not group and rest:
                groups.insert(0, rest)
        except (ValueError, cv2.error) as error:
            reason = FitError(
                f"the fit broke down ({error})",
                where=group[0].name,
                remedy="look at the overlays for marks with wrong numbers",
            )
            failed |= {take.name: reason for take in group}
    return states, failed


def _fit_wavefronts(
    states: list[LensState],
    progress: Progress,
    effort: Effort,
    allowed: Collection[str] | None,
) -> tuple[dict[float, WavefrontFit], dict[float, str]]:
    """One for each focal length whose dots can be used, and why others cannot be."""
    found: dict[float, WavefrontFit] = {}
    without: dict[float, str] = {}
    for focal_mm, mine in by_focal_length(states).items():
        pictured = [s for state in mine for s in _shown_of(state)]
        shown = [s for s in pictured if hole_cells(s) <= LARGEST_HOLE_CELLS]
        if pictured and not shown:
            without[focal_mm] = (
                "the dots themselves are too large; photograph holes less than 1.8 "
                "pixels wide"
            )
        if not shown:
            continue
        try:
            found[focal_mm] = fit_wavefront(
                shown,
                _widest_fall_off(mine),
                progress,
                effort=effort,
                allowed=allowed,
            )
        except (ValueError, np.linalg.LinAlgError) as error:
            without[focal_mm] = f"the dots' shape could not be fitted ({error})"
    return found, without


def _shown_of(state: LensState) -> list[Shown]:
    """The photographs of a state whose dots show the lens' blur."""
    colour = None
    if state.colour:
        colour = state.colour["r"].optics(), state.colour["b"].optics()
    return [
        Shown(
            take,
            take.cutouts,
            state.geometry,
            state.distortion,
            colour,
            k,
            state.pupil.offset_mm,
        )
        for k, take in enumerate(state.geometry.takes)
        if take.cutouts is not None and take.f_number is not None
    ]


def _widest_fall_off(states: list[LensState]) -> FallOffFit | None:
    known = [
        (fall_off.f_number, k, fall_off)
        for k, state in enumerate(states)
        for fall_off in state.fall_off
        if fall_off.f_number is not None
    ]
    return min(known)[-1] if known else None


def _require_like_focus(takes: list[Take]) -> None:
    for focal_mm in sorted({take.focal_length_mm for take in takes}):
        mine = [take for take in takes if take.focal_length_mm == focal_mm]
        silent_ones = [take for take in mine if take.focus_distance_mm is None]
        if silent_ones and len(silent_ones) < len(mine):
            raise FitError(
                f"no focus distance is stated, but other takes at {focal_mm:g} mm "
                "state theirs",
                where=silent_ones[0].name,
                remedy="add focus_distance_mm to every take of that focal length",
            )

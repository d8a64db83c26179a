"""Lens states that share the parameters which do not change with focus.

Each state is fitted on its own first. The entrance pupil, its shift with field angle,
and the decentring terms are nearly the same at every focus distance, but only tilted
views determine them. Per focal length they are taken from the state with the smallest
standard deviation, and the other states are fitted again with these values as priors.
A photograph that contradicts the others is left out, and the rest is fitted.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from lensfit.errors import FitError
from lensfit.fitting.chart_view import View, views_by_state
from lensfit.fitting.decentring import DecentringTerms, decentring_of
from lensfit.fitting.entrance_pupil import (
    perspective_at_other_focus,
    perspective_with_pupil_shift,
)
from lensfit.fitting.joint_adjustment import pupil_shift_with_shared_errors
from lensfit.fitting.lens_state import LensState, fit_state, states_by_focal_length
from lensfit.fitting.usual_lens import KnownPerspective
from lensfit.optics.projection import BaseProjection
from lensfit.progress import Progress


def fit_states_with_shared_parameters(
    views: list[View], progress: Progress
) -> tuple[list[LensState], dict[str, FitError]]:
    """Fit every state, with shared parameters from the states that determine them.

    An entrance pupil that is off by some share of the chart's distance changes the
    scale of a state by the same share. Tilts of a few degrees determine it weakly, so
    that another solve gives another value: the state which supplies the shared values
    is therefore not fitted again, except for the shift of the pupil with field angle.
    A state that cannot be fitted with the shared values keeps its own fit.

    Returns
    -------
    The states, in the order of their photographs, and why views failed, by name.
    """
    groups = views_by_state(views)
    states, failed = _fit_states(groups, progress, _no_priors, all_views=views)
    states = _with_corrected_pupil_shift(states, progress, views)
    shared = {
        focal_mm: _shared_parameters_of(mine)
        for focal_mm, mine in states_by_focal_length(states).items()
    }
    dependent = [s for s in states if _is_dependent(s, shared[s.focal_length_mm])]
    final = [s for s in states if s not in dependent]
    final_names = _take_names(final)
    remaining = [g for g in groups if not any(t.name in final_names for t in g)]

    def priors_of(group: list[View]) -> _Priors:
        mine = shared.get(group[0].focal_length_mm, _SharedParameters())
        return _Priors(_perspective_for(group, mine), mine.decentring)

    refitted, failed_again = _fit_states(
        remaining, progress, priors_of, all_views=views, before=final
    )
    refitted_names = _take_names(refitted)
    alone = [s for s in dependent if refitted_names.isdisjoint(_take_names([s]))]
    every = [*final, *refitted, *alone]
    used = _take_names(every)
    failed = {n: why for n, why in (failed | failed_again).items() if n not in used}
    return _states_in_order(every, views), failed


class _Priors(NamedTuple):
    """Values of shared parameters from another state; None where there are none."""

    perspective: KnownPerspective | None = None
    decentring: DecentringTerms | None = None


def _no_priors(_: list[View]) -> _Priors:
    return _Priors()


def _with_corrected_pupil_shift(
    states: list[LensState], progress: Progress, views: list[View]
) -> list[LensState]:
    """The states; of each focal length the state that supplies the shared values is
    fitted again if errors common to all its detections distorted the shift of its pupil
    with field angle (`joint_adjustment.pupil_shift_with_shared_errors`)."""
    found = []
    for mine in states_by_focal_length(states).values():
        source = _state_of_best_known_pupil(mine)
        corrected = pupil_shift_with_shared_errors(source)
        priors = _Priors(
            perspective_with_pupil_shift(source.geometry, source.pupil_shift, corrected)
        )
        refitted = []
        if priors.perspective is not None:
            group = list(source.geometry.takes)
            refitted, _ = _fit_states(
                [group],
                progress,
                lambda _, p=priors: p,
                all_views=views,
                before=[source],
            )
        complete = _take_names(refitted) == _take_names([source])
        found += [s for s in mine if not (complete and s is source)]
        found += refitted if complete else []
    return _states_in_order(found, views)


def _take_names(states: list[LensState]) -> set[str]:
    """Names of the views that the states were fitted to."""
    return {view.name for state in states for view in state.geometry.takes}


class _SharedParameters(NamedTuple):
    """What the states of one focal length determine; None where none of them does.

    Attributes
    ----------
    pupil_source : The state whose entrance pupil has the smallest standard deviation.
    decentring : Decentring terms of the state whose axis has the smallest one.
    """

    pupil_source: LensState | None = None
    decentring: DecentringTerms | None = None


def _shared_parameters_of(states: list[LensState]) -> _SharedParameters:
    candidates = [s for s in states if s.geometry.focal_length_free]
    sources = sorted(candidates, key=_axis_deviation)[:1]
    decentring = [decentring_of(state.geometry.adjustment) for state in sources]
    return _SharedParameters(_state_of_best_known_pupil(states), *decentring)


def _state_of_best_known_pupil(states: list[LensState]) -> LensState:
    return min(states, key=lambda state: state.pupil.standard_deviation_mm)


def _perspective_for(
    group: list[View], shared: _SharedParameters
) -> KnownPerspective | None:
    """Prior of a group's entrance pupil, from another state of the lens."""
    source = shared.pupil_source
    if source is None or _take_names([source]) & {view.name for view in group}:
        return None
    return perspective_at_other_focus(
        source.pupil,
        source.pupil_shift,
        group[0].focal_length_mm,
        group[0].corner_mm,
        source.focus_distance_mm,
        group[0].focus_distance_mm,
    )


def _is_dependent(state: LensState, shared: _SharedParameters) -> bool:
    """Whether another state determines a shared parameter better than this one."""
    pupil = state is not shared.pupil_source
    centre = shared.decentring is not None and not state.geometry.focal_length_free
    return pupil or centre


def _axis_deviation(state: LensState) -> float:
    return float(np.hypot(*state.uncertainty.deviation("principal_point")))


def _states_in_order(states: list[LensState], views: list[View]) -> list[LensState]:
    """Sorted as their photographs are in `views`."""
    place = {view.name: k for k, view in enumerate(views)}
    return sorted(states, key=lambda s: min(place[t.name] for t in s.geometry.takes))


def _fit_states(
    groups: list[list[View]],
    progress: Progress,
    priors_of: Callable[[list[View]], _Priors],
    *,
    all_views: list[View],
    before: Sequence[LensState] = (),
) -> tuple[list[LensState], dict[str, FitError]]:
    """One state for each group, without the views that contradict their group.

    Parameters
    ----------
    priors_of : Shared parameters of a group, from other states.
    all_views : Views of all states of the lens.
    before : States whose ideal projection the new ones share; if empty, the first
        new state selects it.
    """
    states: list[LensState] = []
    failed: dict[str, FitError] = {}
    base: BaseProjection | None = before[0].distortion.base if before else None
    remaining = list(groups)
    while remaining:
        group = remaining.pop(0)
        perspective, decentring = priors_of(group)
        try:
            state = fit_state(
                group,
                progress,
                all_views=all_views,
                base=base,
                perspective=perspective,
                known_decentring=decentring,
            )
        except FitError as error:
            # One photograph that contradicts itself must not cost the others.
            rest = [view for view in group if view.name != error.where]
            at_fault = [view for view in group if view.name == error.where] or group
            failed |= {view.name: error for view in at_fault}
            if at_fault is not group and rest:
                remaining.insert(0, rest)
        except (ValueError, cv2.error) as error:
            reason = FitError(
                f"the fit broke down ({error})",
                where=group[0].name,
                remedy="look at the overlays for points with wrong numbers",
            )
            failed |= {view.name: reason for view in group}
        else:
            states.append(state)
            base = state.distortion.base if base is None else base
    return states, failed

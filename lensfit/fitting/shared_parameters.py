"""Every state of a lens by itself, but for what its glass does at every focus.

A state whose photographs do not tell where the entrance pupil is, or what elements out
of centre do, takes over what others of its focal length told. What one photograph
contradicts costs no other.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from lensfit.errors import FitError
from lensfit.fitting.decentring import OutOfCentre, told_by
from lensfit.fitting.entrance_pupil import (
    perspective_at_other_focus,
    perspective_with_walk,
)
from lensfit.fitting.joint_adjustment import walk_with_shared_errors
from lensfit.fitting.lens_state import LensState, by_focal_length, fit_state
from lensfit.fitting.take import Take, grouped
from lensfit.fitting.usual_lens import KnownPerspective
from lensfit.optics.base import BaseProjection
from lensfit.progress import Progress


def fit_sharing_glass(
    takes: list[Take], progress: Progress
) -> tuple[list[LensState], dict[str, FitError]]:
    """Every state; those that do not see all of their glass with what others see.

    A pupil that is wrong by some share of the chart's distance scales a state by as
    much. A tilt of few degrees hardly tells it, and another solve would find another
    one: the states that told it stay as they were then, but for the walk of the pupil.
    A state that cannot be fitted with
    what others saw stays as it was, too.

    Returns
    -------
    The states, as their photographs come, and why takes failed, by name.
    """
    groups = grouped(takes)
    states, failed = _fit_states(groups, progress, _nothing_known, shown=takes)
    states = _with_surer_walk(states, progress, takes)
    glass = {
        focal_mm: _told(mine) for focal_mm, mine in by_focal_length(states).items()
    }
    lacking = [s for s in states if _lacks(s, glass[s.focal_length_mm])]
    final = [s for s in states if s not in lacking]
    settled = _names_in(final)
    open_yet = [g for g in groups if not any(take.name in settled for take in g)]

    def told(group: list[Take]) -> _Known:
        mine = glass.get(group[0].focal_length_mm, _Glass())
        return _Known(_perspective_for(group, mine), mine.out_of_centre)

    again, failed_again = _fit_states(
        open_yet, progress, told, shown=takes, before=final
    )
    refitted = _names_in(again)
    alone = [s for s in lacking if refitted.isdisjoint(_names_in([s]))]
    every = [*final, *again, *alone]
    used = _names_in(every)
    failed = {n: why for n, why in (failed | failed_again).items() if n not in used}
    return _in_order(every, takes), failed


class _Known(NamedTuple):
    """What is known of a state before its photographs are seen; None for nothing."""

    perspective: KnownPerspective | None = None
    out_of_centre: OutOfCentre | None = None


def _nothing_known(_: list[Take]) -> _Known:
    return _Known()


def _with_surer_walk(
    states: list[LensState], progress: Progress, takes: list[Take]
) -> list[LensState]:
    """With those refitted that would tell others a walk of the pupil which errors that
    their marks share have made (`joint_adjustment`)."""
    found = []
    for mine in by_focal_length(states).values():
        surest = _surest(mine)
        surer = walk_with_shared_errors(surest)
        known = _Known(perspective_with_walk(surest.geometry, surest.walk, surer))
        again = []
        if known.perspective is not None:
            group = list(surest.geometry.takes)
            again, _ = _fit_states(
                [group], progress, lambda _, k=known: k, shown=takes, before=[surest]
            )
        whole = _names_in(again) == _names_in([surest])
        found += [s for s in mine if not (whole and s is surest)]
        found += again if whole else []
    return _in_order(found, takes)


def _names_in(states: list[LensState]) -> set[str]:
    """Of the takes that states were fitted to."""
    return {take.name for state in states for take in state.geometry.takes}


class _Glass(NamedTuple):
    """What states of one focal length told; None where none of them did.

    Attributes
    ----------
    surest : State that knows its entrance pupil best.
    out_of_centre : What elements out of centre do.
    """

    surest: LensState | None = None
    out_of_centre: OutOfCentre | None = None


def _told(states: list[LensState]) -> _Glass:
    telling = [s for s in states if s.geometry.tells_out_of_centre]
    surest = sorted(telling, key=_unsure_axis)[:1]
    told = [told_by(state.geometry.adjustment) for state in surest]
    return _Glass(_surest(states), *told)


def _surest(states: list[LensState]) -> LensState:
    return min(states, key=lambda state: state.pupil.standard_deviation_mm)


def _perspective_for(group: list[Take], glass: _Glass) -> KnownPerspective | None:
    """That of a group, as another state of the lens told it."""
    surest = glass.surest
    if surest is None or _names_in([surest]) & {take.name for take in group}:
        return None
    return perspective_at_other_focus(
        surest.pupil,
        surest.walk,
        group[0].focal_length_mm,
        surest.focus_distance_mm,
        group[0].focus_distance_mm,
    )


def _lacks(state: LensState, glass: _Glass) -> bool:
    """Whether others told what this one does not see."""
    pupil = state is not glass.surest
    centre = glass.out_of_centre is not None and not state.geometry.focal_length_free
    return pupil or centre


def _unsure_axis(state: LensState) -> float:
    return float(np.hypot(*state.uncertainty.deviation("principal_point")))


def _in_order(states: list[LensState], takes: list[Take]) -> list[LensState]:
    """As their photographs come."""
    place = {take.name: k for k, take in enumerate(takes)}
    return sorted(states, key=lambda s: min(place[t.name] for t in s.geometry.takes))


def _fit_states(
    groups: list[list[Take]],
    progress: Progress,
    known: Callable[[list[Take]], _Known],
    *,
    shown: list[Take],
    before: Sequence[LensState] = (),
) -> tuple[list[LensState], dict[str, FitError]]:
    """One for each group, but for the takes that contradict the others of theirs.

    Parameters
    ----------
    known : Of a group, as other states told it.
    shown : Takes of all states of the lens.
    before : States whose ideal projection the new ones share; without them that of
        the first.
    """
    states: list[LensState] = []
    failed: dict[str, FitError] = {}
    base: BaseProjection | None = before[0].distortion.base if before else None
    left = list(groups)
    while left:
        group = left.pop(0)
        perspective, out_of_centre = known(group)
        try:
            state = fit_state(
                group,
                progress,
                shown=shown,
                base=base,
                perspective=perspective,
                told=out_of_centre,
            )
        except FitError as error:
            # One photograph that contradicts itself must not cost the others.
            rest = [take for take in group if take.name != error.where]
            at_fault = [take for take in group if take.name == error.where] or group
            failed |= {take.name: error for take in at_fault}
            if at_fault is not group and rest:
                left.insert(0, rest)
        except (ValueError, cv2.error) as error:
            reason = FitError(
                f"the fit broke down ({error})",
                where=group[0].name,
                remedy="look at the overlays for marks with wrong numbers",
            )
            failed |= {take.name: reason for take in group}
        else:
            states.append(state)
            base = state.distortion.base if base is None else base
    return states, failed

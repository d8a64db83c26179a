"""All states of a lens: one fit per focal length and focus distance.

Takes of one state share their geometry and colour; fall-off belongs to each f-number.
All states of one focal length share the wavefront, which is fitted to the shape of
their dots. It says where chief rays land, as opposed to centroids, and geometry and
colour are then fitted again to those.
"""

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import cv2
import jax
import numpy as np

from lensfit.errors import FitError
from lensfit.fit.chief_ray import ChiefRayFit, fit_chief_ray
from lensfit.fit.colour import ChannelColour, fit_colour
from lensfit.fit.entrance_pupil import EntrancePupil, measured_pupil
from lensfit.fit.geometry import distortion_of
from lensfit.fit.illumination import FallOffFit, fit_illumination
from lensfit.fit.take import Take, grouped
from lensfit.fit.uncertainty import Uncertainty, uncertainty_of
from lensfit.fit.wavefront.effort import Effort
from lensfit.fit.wavefront.fit import WavefrontFit, fit_wavefront
from lensfit.fit.wavefront.place import placed
from lensfit.fit.wavefront.shown import LARGEST_HOLE_CELLS, Shown, hole_cells
from lensfit.fit.wavefront.uncertainty import parameter_moves
from lensfit.optics.base import BaseProjection
from lensfit.optics.distortion import Distortion, without_idle_degrees
from lensfit.progress import Progress, silent


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
    colour : Red and blue against green; empty for monochrome photographs.
    fall_off : One for each f-number.
    """

    focal_length_mm: float
    focus_distance_mm: float | None
    geometry: ChiefRayFit
    distortion: Distortion
    uncertainty: Uncertainty
    pupil: EntrancePupil
    colour: dict[str, ChannelColour]
    fall_off: list[FallOffFit]


@dataclass(frozen=True, eq=False)
class Fitted:
    """What came of all takes.

    Attributes
    ----------
    states : Those that could be fitted.
    failed : Why others could not, by take name.
    wavefronts : Of the dots' shape, by focal length.
    notes : One sentence for each thing the photographer should know.
    seconds : Of the fits of shape.
    """

    states: tuple[LensState, ...]
    failed: dict[str, FitError]
    wavefronts: dict[float, WavefrontFit] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)


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
    states, failed = _fit_states(takes, progress)
    if not states:
        raise next(iter(failed.values()), FitError("there are no photographs to fit"))
    pupils = _pupils_of(states)
    if any(_stands_elsewhere(state, pupils) for state in states):
        states, failed = _fit_states(takes, progress, pupils)
    began = time.perf_counter()
    wavefronts, notes = _fit_wavefronts(states, progress, effort, allowed)
    if not wavefronts:
        return Fitted(tuple(states), failed, notes=tuple(notes))
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
    again, failed = _fit_states(moved, progress, pupils)
    states = [_suited(states, state) for state in again]
    return Fitted(tuple(states), failed, wavefronts, tuple(notes), seconds)


def _suited(before: list[LensState], after: LensState) -> LensState:
    """The state of marks moved to chief rays, or of their centroids.

    Behind cylinders the wavefront leaves errors of a tenth of the blur, and moved marks
    share them; the state that predicts its marks better stays.
    """
    if all(take.squeeze == 1.0 for take in after.geometry.takes):
        return after
    same = [
        one
        for one in before
        if one.focal_length_mm == after.focal_length_mm
        and one.focus_distance_mm == after.focus_distance_mm
    ]
    return min([after, *same], key=lambda one: one.geometry.held_out_rms_px)


def _pupils_of(states: list[LensState]) -> dict[float, float]:
    """Measured places of the entrance pupil, by focal length; mm before the sensor."""
    seen = [state for state in states if state.pupil.measured]
    focal_mm = {state.focal_length_mm for state in seen}
    return {
        one: float(
            np.median([s.pupil.offset_mm for s in seen if s.focal_length_mm == one])
        )
        for one in sorted(focal_mm)
    }


def _stands_elsewhere(state: LensState, pupils: Mapping[float, float]) -> bool:
    """Whether a state assumed a pupil that others measured."""
    return not state.pupil.measured and state.focal_length_mm in pupils


def _fit_states(
    takes: list[Take], progress: Progress, pupils: Mapping[float, float] | None = None
) -> tuple[list[LensState], dict[str, FitError]]:
    """Every state by itself; `pupils` as in `_pupils_of`."""
    states, failed = [], {}
    groups = grouped(takes)
    while groups:
        group = groups.pop(0)
        try:
            base = states[0].distortion.base if states else None
            pupil_mm = (pupils or {}).get(group[0].focal_length_mm)
            states.append(_fit_state(group, takes, progress, base, pupil_mm))
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
) -> tuple[dict[float, WavefrontFit], list[str]]:
    """One for each focal length whose dots can be used."""
    found, notes = {}, []
    for focal_mm in sorted({state.focal_length_mm for state in states}):
        mine = [state for state in states if state.focal_length_mm == focal_mm]
        pictured = [s for state in mine for s in _shown_of(state)]
        shown = [s for s in pictured if hole_cells(s) <= LARGEST_HOLE_CELLS]
        if pictured and not shown:
            notes.append(
                f"the blur at {focal_mm:g} mm was not measured: the dots themselves "
                "are too large; photograph holes less than 1.8 pixels wide"
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
            notes.append(
                f"the dots' shape at {focal_mm:g} mm could not be fitted ({error})"
            )
    return found, notes


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


_distortion_of = jax.jit(distortion_of, static_argnames=("layout",))


def _fit_state(
    group: list[Take],
    takes: list[Take],
    progress: Progress,
    base: BaseProjection | None,
    pupil_mm: float | None,
) -> LensState:
    """`base` is that of the states before, so that states can be interpolated."""
    geometry = fit_chief_ray(
        group, progress, shown=takes, base=base, pupil_offset_mm=pupil_mm
    )
    adjustment = geometry.adjustment
    layout = adjustment.layout
    shared = adjustment.parameters[: layout.shared]
    lens = _distortion_of(shared, layout, adjustment.frame)
    # On the host, where taking an array apart compiles nothing.
    distortion = without_idle_degrees(jax.device_get(lens))
    centre = np.asarray(distortion.principal_point_mm)
    radius = float(distortion.reference_radius_mm)
    uncertainty = uncertainty_of(adjustment, geometry.takes)
    assumed_mm = (
        float(distortion.principal_distance_mm) if pupil_mm is None else pupil_mm
    )
    return LensState(
        focal_length_mm=group[0].focal_length_mm,
        focus_distance_mm=group[0].focus_distance_mm,
        geometry=geometry,
        distortion=distortion,
        uncertainty=uncertainty,
        pupil=measured_pupil(geometry, uncertainty)
        or EntrancePupil(assumed_mm, measured=pupil_mm is not None),
        colour=fit_colour(geometry.takes, centre, radius),
        fall_off=fit_illumination(geometry.takes, adjustment, centre),
    )

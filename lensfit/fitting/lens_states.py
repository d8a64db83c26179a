"""The fit of a lens: all its states, a state being a focal length and a focus distance.

1. Geometry, fall-off and lateral colour of every state are fitted to the centroids of
   the detections (`lens_state`). States of one focal length share the entrance pupil
   and the decentring that one of them determines (`shared_parameters`).
2. For each focal length a wavefront is fitted to the images of the dots
   (`lens_wavefronts`). It predicts the centroid bias: centroid minus chief ray.
3. The biases are subtracted, also those of lines beside dots, and geometry and colour
   are fitted again, now to chief rays.
4. Where these states fit worse than those of the centroids, or where a mosaic hides the
   shape of the dots, a joint adjustment of geometry and wavefront corrects the
   wavefront (`joint_adjustment`), and step 3 is repeated. The result is used where it
   has the smaller held-out error.
"""

import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from threadpoolctl import threadpool_limits

from lensfit.errors import FitError
from lensfit.fitting.breathing import reversed_breathing
from lensfit.fitting.chart_view import View
from lensfit.fitting.joint_adjustment import error_amplitudes
from lensfit.fitting.lens_state import (
    LensState,
    engraved_focal_lengths,
    mean_held_out_rms_px,
    more_accurate_state,
    states_by_focal_length,
    states_worse_at_chief_rays,
    with_colour,
)
from lensfit.fitting.lens_wavefronts import fit_wavefronts
from lensfit.fitting.shared_parameters import fit_states_with_shared_parameters
from lensfit.fitting.wavefront.adjusted_wavefront import (
    adjust_wavefront,
    chief_ray_takes_with_shared_moves,
    takes_with_error_moves,
    wavefront_errors,
)
from lensfit.fitting.wavefront.effort import Effort
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.progress import Progress, silent


@dataclass(frozen=True, eq=False)
class FittedLens:
    """The result of a fit.

    Attributes
    ----------
    states : The states that were fitted.
    failed : Why the other views were not, by their name.
    wavefronts : Wavefronts, by focal length.
    unmeasured_blur : Why a focal length has no wavefront though dots were photographed,
        and the remedy.
    takes_with_wide_dots : Views whose dots were too wide for the wavefront, by focal
        length.
    seconds : Duration of the wavefront fits.
    doubtful_states : Those of `states_worse_at_chief_rays`.
    """

    states: tuple[LensState, ...]
    failed: dict[str, FitError]
    wavefronts: dict[float, WavefrontFit] = field(default_factory=dict)
    unmeasured_blur: dict[float, str] = field(default_factory=dict)
    takes_with_wide_dots: dict[float, list[str]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    doubtful_states: tuple[LensState, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each thing the photographer should know."""
        unmeasured = tuple(
            f"the blur at {focal_mm:g} mm was not measured: {reason}"
            for focal_mm, reason in self.unmeasured_blur.items()
        )
        takes_with_wide_dots = (
            f"the blur at {focal_mm:g} mm was measured from smaller dots than those "
            f"of {', '.join(names)}, which were left out"
            for focal_mm, names in self.takes_with_wide_dots.items()
            if names
        )
        engraved = engraved_focal_lengths(self.states)
        stated = list(engraved.values())
        stated += [
            one
            for state in self.states
            for one in state.geometry.statements
            if one.quantity != "focal_length" or state.focal_length_mm not in engraved
        ]
        return (
            *(one.sentence for one in stated if one.contradicts),
            *unmeasured,
            *takes_with_wide_dots,
            *self._notes_of_doubtful_states(),
            *reversed_breathing(self.states).values(),
        )

    def _notes_of_doubtful_states(self) -> Iterator[str]:
        for state in self.doubtful_states:
            focus = state.focus_distance_mm
            where = "" if focus is None else f" focused at {focus:g} mm"
            yield (
                f"at {state.focal_length_mm:g} mm{where} the points fit one lens worse "
                "where the measured blur says that chief rays land than where they "
                "were found: coma is not well measured there, and chief rays may be "
                "off by more than is stated; photograph smaller dots or more pixels"
            )


# Matrices of a few hundred rows gain nothing from several BLAS threads, which spin
# while they wait: on a busy machine lateral colour took seven times longer.
@threadpool_limits.wrap(limits=1, user_api="blas")
def fit(
    views: list[View],
    progress: Progress = silent,
    *,
    effort: Effort = Effort.NORMAL,
    allowed: Collection[str] | None = None,
) -> FittedLens:
    """Fit a lens to the detections of its photographs.

    Parameters
    ----------
    views : One for each photograph; any number of focal lengths, focus distances and
        f-numbers of one lens.
    progress : Called with the progress of each stage.
    effort : Trade-off between speed and accuracy of the wavefront fit.
    allowed : Term groups of the wavefront that may be free (`fit_wavefront`).

    Raises
    ------
    FitError : No state could be fitted (single failures are returned in `failed`), or
        only some views of a focal length state their focus distance.
    """
    _require_consistent_focus(views)
    states, failed = fit_states_with_shared_parameters(views, progress)
    if not states:
        raise next(iter(failed.values()), FitError("there are no photographs to fit"))
    states = with_colour(states)
    began = time.perf_counter()
    wavefronts, without, takes_with_wide_dots = fit_wavefronts(
        states, progress, effort, allowed
    )
    if not wavefronts:
        return FittedLens(tuple(states), failed, unmeasured_blur=without)
    seconds = {"fit_wavefront": time.perf_counter() - began}
    first = _fit_at_chief_rays(views, wavefronts, progress)
    corrected = _jointly_corrected_wavefronts(states, first)
    last = _fit_with_corrected_wavefronts(views, first, corrected, progress)
    chosen = [more_accurate_state(state, states) for state in last.states]
    return FittedLens(
        tuple(chosen),
        last.failed,
        last.wavefronts,
        without,
        takes_with_wide_dots,
        seconds,
        states_worse_at_chief_rays(chosen, states),
    )


class _ChiefRayStates(NamedTuple):
    """States fitted to chief rays.

    Attributes
    ----------
    wavefronts : From which the centroid biases were predicted, by focal length.
    views : With detections moved from centroids to chief rays, by focal length.
    states, failed : As of `FittedLens`.
    """

    wavefronts: dict[float, WavefrontFit]
    views: dict[float, list[View]]
    states: list[LensState]
    failed: dict[str, FitError]


def _fit_at_chief_rays(
    views: list[View], wavefronts: dict[float, WavefrontFit], progress: Progress
) -> _ChiefRayStates:
    by_focal = {
        focal_mm: chief_ray_takes_with_shared_moves(found)
        for focal_mm, found in wavefronts.items()
    }
    by_name = {view.name: view for mine in by_focal.values() for view in mine}
    chief_ray_views = [by_name.get(view.name, view) for view in views]
    states, failed = fit_states_with_shared_parameters(chief_ray_views, progress)
    return _ChiefRayStates(wavefronts, by_focal, with_colour(states), failed)


def _fit_with_corrected_wavefronts(
    views: list[View],
    first: _ChiefRayStates,
    corrected: dict[float, WavefrontFit],
    progress: Progress,
) -> _ChiefRayStates:
    """States fitted with the corrected wavefronts of those focal lengths whose held-out
    error they reduce, and with the wavefronts of `first` otherwise."""
    while corrected:
        found = _fit_at_chief_rays(views, first.wavefronts | corrected, progress)
        if found.failed.keys() != first.failed.keys():
            break
        better = _focal_lengths_with_smaller_error(found.states, first.states)
        if corrected.keys() <= better:
            return found
        corrected = {mm: corrected[mm] for mm in corrected.keys() & better}
    return first


def _jointly_corrected_wavefronts(
    states: list[LensState], first: _ChiefRayStates
) -> dict[float, WavefrontFit]:
    """Wavefronts corrected by a joint adjustment with the geometry, by focal length.

    They are computed where the fit to chief rays (`first`) has a larger held-out error
    than the fit to centroids (`states`), and behind a mosaic, which disturbs the shape
    of a dot's image more than its position.
    """
    corrected = {}
    centroids = states_by_focal_length(states)
    worse = _focal_lengths_with_smaller_error(states, first.states)
    for focal_mm, found in first.wavefronts.items():
        if not (found.behind_mosaic or focal_mm in worse):
            continue
        errors = wavefront_errors(found)
        moved = takes_with_error_moves(first.views[focal_mm], found, errors)
        amplitudes = error_amplitudes(centroids[focal_mm], moved)
        # The views list further errors, of their photographs and not of the wavefront.
        adjusted = adjust_wavefront(found, errors, amplitudes.leading(len(errors)))
        if adjusted is not None:
            corrected[focal_mm] = adjusted
    return corrected


def _focal_lengths_with_smaller_error(
    states: list[LensState], others: list[LensState]
) -> set[float]:
    """Focal lengths at which `states` have a smaller held-out error than `others`."""
    mine, theirs = states_by_focal_length(states), states_by_focal_length(others)
    return {
        focal_mm
        for focal_mm in mine.keys() & theirs.keys()
        if mean_held_out_rms_px(mine[focal_mm]) < mean_held_out_rms_px(theirs[focal_mm])
    }


def _require_consistent_focus(views: list[View]) -> None:
    for focal_mm in sorted({view.focal_length_mm for view in views}):
        mine = [view for view in views if view.focal_length_mm == focal_mm]
        unstated = [view for view in mine if view.focus_distance_mm is None]
        if unstated and len(unstated) < len(mine):
            raise FitError(
                f"no focus distance is stated, but other takes at {focal_mm:g} mm "
                "state theirs",
                where=unstated[0].name,
                remedy="add focus_distance_mm to every take of that focal length",
            )

"""All states of a lens: one fit per focal length and focus distance (`lens_state`).

States of one focal length share the entrance pupil that any of them measured, and the
wavefront, which is fitted to the shape of their dots. It says where chief rays land, as
opposed to centroids; once the marks themselves have had their say of that
(`joint_adjustment`), geometry and colour are fitted again to those.
"""

import time
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import NamedTuple

from threadpoolctl import threadpool_limits

from lensfit.errors import FitError
from lensfit.fitting.breathing import breathing_notes
from lensfit.fitting.joint_adjustment import amounts_of
from lensfit.fitting.lens_state import (
    LensState,
    better_told,
    by_focal_length,
    left_px,
    with_colour,
)
from lensfit.fitting.lens_wavefronts import fit_wavefronts
from lensfit.fitting.shared_parameters import fit_sharing_glass
from lensfit.fitting.take import Take
from lensfit.fitting.wavefront.adjusted_wavefront import (
    at_chief_rays,
    errors_of,
    moved_by,
    told_by_marks,
)
from lensfit.fitting.wavefront.effort import Effort
from lensfit.fitting.wavefront.fit import WavefrontFit
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
    too_wide : Takes whose dots were left out of a wavefront, by focal length.
    seconds : Of the fits of shape.
    """

    states: tuple[LensState, ...]
    failed: dict[str, FitError]
    wavefronts: dict[float, WavefrontFit] = field(default_factory=dict)
    without_shape: dict[float, str] = field(default_factory=dict)
    too_wide: dict[float, list[str]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for each thing the photographer should know."""
        unmeasured = tuple(
            f"the blur at {focal_mm:g} mm was not measured: {reason}"
            for focal_mm, reason in self.without_shape.items()
        )
        too_wide = (
            f"the dots of {', '.join(names)} are too wide and were left out of the "
            f"blur at {focal_mm:g} mm: photograph holes less than 1.8 pixels wide"
            for focal_mm, names in self.too_wide.items()
            if names
        )
        contradicted = (
            one.sentence
            for state in self.states
            for one in state.geometry.statements
            if one.contradicts
        )
        return (
            *contradicted,
            *unmeasured,
            *too_wide,
            *breathing_notes(self.states),
        )


# Matrices of a few hundred rows gain nothing from several BLAS threads, which spin
# while they wait: on a busy machine lateral colour took seven times longer.
@threadpool_limits.wrap(limits=1, user_api="blas")
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
    states, failed = fit_sharing_glass(takes, progress)
    if not states:
        raise next(iter(failed.values()), FitError("there are no photographs to fit"))
    states = with_colour(states)
    began = time.perf_counter()
    wavefronts, without, too_wide = fit_wavefronts(states, progress, effort, allowed)
    if not wavefronts:
        return Fitted(tuple(states), failed, without_shape=without)
    seconds = {"fit_wavefront": time.perf_counter() - began}
    first = _fit_at_chief_rays(takes, wavefronts, progress)
    told = _told_by_marks(states, first)
    last = _kept_where_closer(takes, first, told, progress)
    states = [better_told(state, states) for state in last.states]
    return Fitted(
        tuple(states), last.failed, last.wavefronts, without, too_wide, seconds
    )


class _AtChiefRays(NamedTuple):
    """States of marks where wavefronts say that chief rays land (`takes`)."""

    wavefronts: dict[float, WavefrontFit]
    takes: dict[float, list[Take]]
    states: list[LensState]
    failed: dict[str, FitError]


def _fit_at_chief_rays(
    takes: list[Take], wavefronts: dict[float, WavefrontFit], progress: Progress
) -> _AtChiefRays:
    there = {focal_mm: at_chief_rays(found) for focal_mm, found in wavefronts.items()}
    moved = {take.name: take for mine in there.values() for take in mine}
    placed = [moved.get(take.name, take) for take in takes]
    states, failed = fit_sharing_glass(placed, progress)
    return _AtChiefRays(wavefronts, there, with_colour(states), failed)


def _kept_where_closer(
    takes: list[Take],
    first: _AtChiefRays,
    told: dict[float, WavefrontFit],
    progress: Progress,
) -> _AtChiefRays:
    """With those of the told wavefronts that leave less of marks held out."""
    while told:
        found = _fit_at_chief_rays(takes, first.wavefronts | told, progress)
        if found.failed.keys() != first.failed.keys():
            break
        closer = _closer(found.states, first.states)
        if told.keys() <= closer:
            return found
        told = {focal_mm: told[focal_mm] for focal_mm in told.keys() & closer}
    return first


def _told_by_marks(
    states: list[LensState], first: _AtChiefRays
) -> dict[float, WavefrontFit]:
    """The wavefronts that marks have had their say of: they are asked where moved marks
    fit one lens worse than centroids do (`states`), and behind a mosaic, which hides
    more of a dot's shape than of its place."""
    told = {}
    centroids = by_focal_length(states)
    worse = _closer(states, first.states)
    for focal_mm, found in first.wavefronts.items():
        if not (found.behind_mosaic or focal_mm in worse):
            continue
        errors = errors_of(found)
        moving = moved_by(first.takes[focal_mm], found, errors)
        said = amounts_of(centroids[focal_mm], moving)
        # What takes list besides is of their photographs, not of the wavefront.
        better = told_by_marks(found, errors, said.of_first(len(errors)))
        if better is not None:
            told[focal_mm] = better
    return told


def _closer(some: list[LensState], others: list[LensState]) -> set[float]:
    """Focal lengths of which some states leave less of their marks than others do."""
    mine, theirs = by_focal_length(some), by_focal_length(others)
    return {
        focal_mm
        for focal_mm in mine.keys() & theirs.keys()
        if left_px(mine[focal_mm]) < left_px(theirs[focal_mm])
    }


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

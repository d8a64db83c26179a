"""The geometric fit of one lens state: poses, focal length, distortion, board errors.

Four stages, each starting from the result of the one before:

1. a compact model (poses and three radial terms; focal length if the views tilt),
   started from homographies, on the base projection with the smallest residuals;
2. named terms by model selection (`select`), in two passes;
3. the free field by model selection, with the named terms held fixed, because the free
   field can reproduce them; then a few damped steps with all selected terms free;
4. the held-out error: half of the detections of every photograph predict the other
   half, for three random partitions.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from lensfit.errors import FitError
from lensfit.fitting.adjust import Adjustment, adjust
from lensfit.fitting.chart_view import View
from lensfit.fitting.decentring import MANUFACTURING_TOLERANCE, DecentringTerms
from lensfit.fitting.held_out import held_out_error_px, squared_px
from lensfit.fitting.parameters import PINHOLE, Layout, stated_blocks
from lensfit.fitting.priors import (
    fixed_prior,
    loose_deviation,
    release,
    with_poses_free,
)
from lensfit.fitting.select import TermDecision
from lensfit.fitting.stage import Start, start_of
from lensfit.fitting.stated_facts import Facts
from lensfit.fitting.stated_scale import with_fitted_scale_as_origin
from lensfit.fitting.statements import Statement
from lensfit.fitting.term_selection import select_terms
from lensfit.fitting.usual_lens import KnownPerspective
from lensfit.optics.base import BASE_PROJECTIONS, BaseProjection
from lensfit.progress import Progress, silent

COMPACT_RADIAL_TERMS = 3
_ODD_SQUEEZE = 1.05
"""Ratio of both axes' scales that no spherical lens and no photosite reaches."""
_WIDE_RADIANS = 0.85
_SAMPLE_PER_VIEW = 512


@dataclass(frozen=True, eq=False)
class ChiefRayFit:
    """A fitted lens state, before colour and fall-off.

    Attributes
    ----------
    takes : The views that were fitted, in the order of the arrays.
    adjustment : The solution.
    kept : Names of the blocks that are free.
    decisions : The decision on every candidate term.
    focal_length_free : Whether the photographs determine the focal length.
    held_out_rms_px, held_out_rms_px_of_take : For all views, and for each; mean over
        random partitions.
    facts : Values that were stated.
    """

    takes: tuple[View, ...]
    adjustment: Adjustment
    kept: tuple[str, ...]
    decisions: tuple[TermDecision, ...]
    focal_length_free: bool
    held_out_rms_px: float
    held_out_rms_px_of_take: tuple[float, ...]
    notes: tuple[str, ...]
    seconds: dict[str, float]
    facts: Facts

    @property
    def determines_decentring(self) -> bool:
        """Whether these views determine the decentring terms."""
        return self.focal_length_free and MANUFACTURING_TOLERANCE.keys() <= set(
            self.kept
        )

    @property
    def statements(self) -> tuple[Statement, ...]:
        """Every stated value of this state, and the fitted one."""
        stated = self.adjustment.statements
        return () if stated is None else stated.table(self.adjustment.parameters)


# Matrices of a few hundred rows gain nothing from several BLAS threads, which spin
# while they wait: on a busy machine a fit took ten times longer.
@threadpool_limits.wrap(limits=1, user_api="blas")
def fit_chief_ray(
    views: list[View],
    progress: Progress = silent,
    *,
    all_views: list[View] | None = None,
    base: BaseProjection | None = None,
    perspective: KnownPerspective | None = None,
    known_decentring: DecentringTerms | None = None,
) -> ChiefRayFit:
    """Fit one lens state (one focal length and focus distance) to its views.

    Parameters
    ----------
    views : Of this state.
    all_views : Views of all states of the lens. The box of the free field covers them,
        so that states can be interpolated.
    base : Ideal projection; by default the one with the smallest residuals.
    perspective : Prior of the entrance pupil from another state; by default that of
        usual lenses.
    known_decentring : Decentring terms that tilted views at another focus distance
        determined.

    Raises
    ------
    FitError : The detections do not determine a lens, or contradict what was stated.
    """
    clock = time.perf_counter
    began = clock()
    require_detections(views)
    start = start_of(views, all_views or views, perspective)
    compact = with_fitted_scale_as_origin(_compact(start, base))
    progress("fit", 1, 5)
    after_compact = clock()
    fitted, kept, decisions = select_terms(start, compact, progress, known_decentring)
    after_selection = clock()
    held_out, per_take = held_out_error_px(fitted)
    progress("fit", 5, 5)
    return ChiefRayFit(
        takes=tuple(views),
        adjustment=fitted,
        kept=kept,
        decisions=tuple(decisions),
        focal_length_free=start.focal_length_free,
        held_out_rms_px=held_out,
        held_out_rms_px_of_take=per_take,
        notes=start.notes + _notes(fitted),
        seconds={
            "fit_compact": after_compact - began,
            "fit_select": after_selection - after_compact,
            "fit_held_out": clock() - after_selection,
        },
        facts=start.facts,
    )


def _notes(fitted: Adjustment) -> tuple[str, ...]:
    """Notes for the user on weak points of the fit."""
    notes = []
    if not fitted.converged:
        notes.append(
            "the fit ended at its step limit: some terms are weakly determined, "
            "see their standard deviations"
        )
    squeezed = fitted.parameters[fitted.layout.blocks["squeeze"]]
    ratio = float(np.exp(np.hypot(*squeezed)))
    if ratio > _ODD_SQUEEZE:
        notes.append(
            f"one axis of the picture is {100 * (ratio - 1):.0f} % longer than stated: "
            "check pitch_mm (a square lattice has one pitch) and anamorphic_squeeze"
        )
    return tuple(notes)


def _compact(start: Start, base: BaseProjection | None) -> Adjustment:
    """Stage 1, on the given base projection or the one with the smallest residuals."""
    bases = BASE_PROJECTIONS[: 2 if start.half_angle_rad > _WIDE_RADIANS else 1]
    bases = bases if base is None else (base,)
    best = None
    for base in bases:
        fitted = _compact_on(start, replace(start.layout, base=base))
        squared = squared_px(fitted)
        score = float(np.median(squared[fitted.stack.present]))
        if best is None or score < 0.95 * best[0]:
            best = (score, fitted)
    assert best is not None
    return best[1]


def _compact_on(start: Start, layout: Layout) -> Adjustment:
    """The compact model on one base projection, fitted to a sample of detections."""
    chunks = start.stack.chunking.sample(_SAMPLE_PER_VIEW)
    prior = with_poses_free(fixed_prior(start.parameters(layout)), layout)
    first = layout.blocks["radial"].start
    prior = release(prior, slice(first, first + COMPACT_RADIAL_TERMS), 0.3)
    for name in stated_blocks(start.pupil_shift_free):
        prior = release(prior, layout.blocks[name], loose_deviation(layout, name))
    adjustment = start.adjustment(layout, prior)
    adjustment = adjust(adjustment, rounds=2, chunks=chunks)
    blocks = ["aperture_shift"]
    if start.focal_length_free:
        blocks += PINHOLE
    for name in blocks:
        prior = release(prior, layout.blocks[name], loose_deviation(layout, name))
    return adjust(replace(adjustment, prior=prior), rounds=2, chunks=chunks)


def require_detections(views: list[View], fewest: int = 12) -> None:
    """Refuse views with too few detections for a pose, or with positions not finite.

    Raises
    ------
    FitError : Names the view.
    """
    for view in views:
        invalid = ~np.isfinite(view.observations.points_px).all(-1)
        if invalid.any():
            raise FitError(
                f"{invalid.sum()} points have a position that is no number",
                where=view.name,
                remedy="leave these points out",
            )
        if len(view.observations) < fewest:
            raise FitError(
                f"only {len(view.observations)} points, {fewest} are needed",
                where=view.name,
                remedy="photograph more of the target",
            )

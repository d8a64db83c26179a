"""The geometric fit of one lens state: poses, focal length, distortion, board errors.

Four stages, each starting from the result of the one before:

1. a compact model (poses and three radial terms; focal length if the views tilt),
   started from homographies, on the base projection with the smallest residuals;
2. named terms by model selection (`select`), in two passes, then bends of the boards;
3. the free field by model selection, with the named terms held fixed, because the free
   field can reproduce them; then a few damped steps with all selected terms free, since
   their minimum is long and curved. The decentring terms enter together where the
   principal point is free (`decentring`);
4. the held-out error: half of the detections of every photograph predict the other
   half, for three random partitions.
"""

import time
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from lensfit.errors import FitError
from lensfit.fitting.adjust import (
    COLLINEAR_DAMPING,
    Adjustment,
    adjust,
    with_fitted_scale_as_origin,
)
from lensfit.fitting.chart_view import View
from lensfit.fitting.decentring import (
    TAKEN_OVER_REASON,
    TOLERANCE_REASON,
    DecentringTerms,
    adjust_with_decentring,
    decentring_is_supported,
    tolerances_of,
)
from lensfit.fitting.geometric_start import Start, start_of
from lensfit.fitting.held_out import (
    explained_by,
    halves_of,
    held_out_error_px,
    squared_px,
    stated_statistics,
)
from lensfit.fitting.parameters import (
    PINHOLE,
    Layout,
    Prior,
    fixed_prior,
    loose_deviation,
    loose_prior,
    release,
    stated_blocks,
    with_poses_free,
)
from lensfit.fitting.select import (
    LEAST_EFFECT_PX,
    Step,
    TermDecision,
    bend_steps,
    choose,
    drift_steps,
    shared_term_groups,
)
from lensfit.fitting.statements import Facts, Statement
from lensfit.fitting.usual_lens import KnownPerspective
from lensfit.optics.projection import BASE_PROJECTIONS, BaseProjection
from lensfit.progress import Progress, silent

COMPACT_RADIAL_TERMS = 3
_ODD_SQUEEZE = 1.05
"""Ratio of both axes' scales that no spherical lens and no photosite reaches."""
_WIDE_RADIANS = 0.85
_SAMPLE_PER_VIEW = 512
_FEWEST_DETECTIONS = 12
"""Of a view, for a pose."""


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
    blocks = ["aperture_shift"] if start.largest.apertures else []
    if start.focal_length_free:
        blocks += PINHOLE
    for name in blocks:
        prior = release(prior, layout.blocks[name], loose_deviation(layout, name))
    return adjust(replace(adjustment, prior=prior), rounds=2, chunks=chunks)


def require_detections(views: list[View]) -> None:
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
        count = len(view.observations)
        if count < _FEWEST_DETECTIONS:
            raise FitError(
                f"only {count} points, {_FEWEST_DETECTIONS} are needed",
                where=view.name,
                remedy="photograph more of the target",
            )


def select_terms(
    start: Start,
    compact: Adjustment,
    progress: Progress,
    known_decentring: DecentringTerms | None = None,
) -> tuple[Adjustment, tuple[str, ...], list[TermDecision]]:
    """Select terms and fit them (stages 2 and 3).

    Parameters
    ----------
    start : The start of the fit.
    compact : The fit of the compact model (stage 1).
    known_decentring : Decentring terms that tilted views at another focus distance
        determined.

    Returns
    -------
    The fit, the names of the free blocks, and a decision for each candidate term.
    """
    views, layout = len(start.takes), compact.layout
    always = _always(layout, start)
    terms = shared_term_groups(layout, start.largest)
    if start.focal_length_free:
        del terms["principal_point"]  # every model contains it then
    free_field = {n: terms.pop(n) for n in ("free_field",) if n in terms}
    adjustment, kept, decisions = compact, {}, []
    for turn in range(2):
        adjustment, kept, decisions = _fit_selected(adjustment, always, terms)
        progress("fit", 2 + turn, 5)
    names = [terms[f][n - 1].name for f, n in kept.items()]
    if layout.bend_degree:
        lens = _indices(always, kept, terms)
        adjustment, more, others = _with_bends(adjustment, lens, views)
        decisions, names = decisions + others, names + more
    if free_field:
        adjustment, more, others = _with_free_field(adjustment, always, free_field)
        decisions, names = decisions + others, names + more
    known_decentring = None if start.focal_length_free else known_decentring
    supported = start.focal_length_free and decentring_is_supported(
        adjustment, decisions
    )
    if supported or known_decentring is not None:
        adjustment = adjust_with_decentring(adjustment, known_decentring)
        tolerated = tolerances_of(layout)
        why = TOLERANCE_REASON if supported else TAKEN_OVER_REASON
        decisions = [
            v.with_override(why) if v.term_group in tolerated else v for v in decisions
        ]
        names = list(dict.fromkeys([*names, *tolerated]))
    progress("fit", 4, 5)
    return adjustment, tuple(names), decisions


def _with_bends(
    adjustment: Adjustment, lens: np.ndarray, views: int
) -> tuple[Adjustment, list[str], list[TermDecision]]:
    """The fit with selected bends of the boards and row drifts. The lens terms stay
    free: in a frontal view a bent board and a distorting lens give the same image."""
    layout = adjustment.layout
    held = np.setdiff1d(lens, _higher_degree_terms(layout))
    bends = {
        "board_bend": bend_steps(layout, views),
        "row_drift": drift_steps(layout, views),
    }
    adjustment, kept, decisions = _fit_selected(adjustment, held, bends)
    everything = np.union1d(lens, _indices(held, kept, bends))
    names = [bends[f][n - 1].name for f, n in kept.items()]
    return _all_free(adjustment, everything), names, decisions


def _with_free_field(
    named: Adjustment, always: np.ndarray, steps: dict[str, list[Step]]
) -> tuple[Adjustment, list[str], list[TermDecision]]:
    """Stage 3: the fit with the selected degree of the free field, all terms free."""
    fitted, kept, decisions = _fit_selected(named, always, steps)
    if not kept:
        return named, [], decisions
    step = steps["free_field"][kept["free_field"] - 1]
    everything = np.union1d(np.flatnonzero(named.prior.free), step.indices)
    return _all_free(fitted, everything), [step.name], decisions


def _all_free(adjustment: Adjustment, everything: np.ndarray) -> Adjustment:
    """One more round with these parameters free, with loose priors around zero."""
    nothing = np.zeros(0, int)
    prior = loose_prior(adjustment.parameters, adjustment.layout, nothing, everything)
    prior = Prior(np.where(prior.free, 0.0, prior.mean), prior.standard_deviation)
    released = replace(adjustment, prior=prior)
    return adjust(released, rounds=1, damping=COLLINEAR_DAMPING)


def _higher_degree_terms(layout: Layout) -> np.ndarray:
    """Lens terms of degree three and more, fixed while bends are selected."""
    blocks = [layout.blocks[name] for name in ("radial", "anamorphic")]
    return np.concatenate([np.arange(b.start, b.stop) for b in blocks])


def _fit_selected(
    adjustment: Adjustment,
    always: np.ndarray,
    terms: dict[str, list[Step]],
) -> tuple[Adjustment, dict[str, int], list[TermDecision]]:
    """Linearise, select among `terms`, and fit the selected model.

    Parameters that are neither in `always` nor in `terms` stay fixed.
    """
    tried = np.unique(
        np.concatenate([always, *(s[-1].indices for s in terms.values())])
    )
    here, layout = adjustment.parameters, adjustment.layout
    everything = loose_prior(here, layout, tried, tried)
    precision = np.where(everything.free, 1.0, 0.0)
    precision = precision / np.maximum(everything.standard_deviation, 1e-30) ** 2
    offset = here - everything.mean
    found = choose(
        halves_of(replace(adjustment, prior=everything)),
        precision,
        offset,
        always,
        terms,
        explained_by(LEAST_EFFECT_PX, adjustment),
        stated_statistics(adjustment),
    )
    chosen = _indices(always, found.kept, terms)
    started = replace(
        adjustment,
        parameters=here + found.step,
        prior=loose_prior(here, layout, tried, chosen),
    )
    return adjust(started), found.kept, found.decisions


def _always(layout: Layout, start: Start) -> np.ndarray:
    """Parameters of every model: poses, those with stated values, and the other pinhole
    parameters if the views tilt enough to determine them."""
    poses = layout.local_indices("pose", len(start.takes)).ravel()
    rest = PINHOLE if start.focal_length_free else ()
    names = (*stated_blocks(start.pupil_shift_free), *rest)
    pinhole = [layout.blocks[name] for name in names]
    known = [np.arange(w.start, w.stop) for w in pinhole]
    return np.concatenate([*known, poses]).astype(int)


def _indices(
    always: np.ndarray, kept: dict[str, int], terms: dict[str, list[Step]]
) -> np.ndarray:
    chosen = [terms[group][level - 1].indices for group, level in kept.items()]
    return np.unique(np.concatenate([always, *chosen]))

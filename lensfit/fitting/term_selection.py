"""Stages 2 and 3 of the geometric fit: model selection and the fit of its result.

The criteria are those of `select`. The named terms of the lens are selected first, in
two passes; then bends of the boards; then the free field, with the named terms held
fixed, because the free field can reproduce them. A few damped steps with all selected
terms free follow, since their minimum is long and curved. The decentring terms
enter together where the principal point is free (`decentring`).
"""

from dataclasses import replace

import numpy as np

from lensfit.fitting.adjust import COLLINEAR_DAMPING, Adjustment, adjust
from lensfit.fitting.decentring import (
    MANUFACTURING_TOLERANCE,
    TOLERANCE_REASON,
    DecentringTerms,
    adjust_with_decentring,
    decentring_is_supported,
)
from lensfit.fitting.half_equations import halves_of, least_fall, stated_statistics
from lensfit.fitting.parameters import PINHOLE, Layout, Prior, stated_blocks
from lensfit.fitting.priors import loose_prior
from lensfit.fitting.select import (
    Step,
    TermDecision,
    bend_steps,
    choose,
    drift_steps,
    shared_term_groups,
)
from lensfit.fitting.stage import Start
from lensfit.progress import Progress


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
        decisions = [
            v.with_override(TOLERANCE_REASON)
            if v.term_group in MANUFACTURING_TOLERANCE
            else v
            for v in decisions
        ]
        names = list(dict.fromkeys([*names, *MANUFACTURING_TOLERANCE]))
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
        *halves_of(replace(adjustment, prior=everything)),
        precision,
        offset,
        always,
        terms,
        least_fall(adjustment),
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

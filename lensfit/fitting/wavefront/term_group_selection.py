"""Model selection: which term groups the photographs support.

All from the normal equations of the largest model, without a new fit (`fitting.trial`):
a term group stays if the Bayesian information criterion improves by it and dots that
were held out, half of a photograph's at a time, are predicted better by more than the
standard error of that. Removing the highest orders is tried first. If a term group
stays, the one that it refines stays too: a lens whose axial colour was left out, while
the colour of its third order stood for it, had red .02 px from where it lands.

Cells of one dot share the model's error of that dot, so they do not count as so many
observations: `CELLS_PER_DOT` of each dot and channel do.

Reference: J. A. Nelder, J. R. Statist. Soc. A 140 (1977) 48, on marginality.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from lensfit.fitting.select import TermDecision
from lensfit.fitting.trial import Statistics, Trial
from lensfit.fitting.wavefront.stages import Stage, folds_of
from lensfit.fitting.wavefront.term_groups import TermGroup, indices_of

CELLS_PER_DOT = 60
_LEAST_BIC_GAIN = 6.0
_REMOVAL_ORDER = (
    "ninth_order",
    "seventh_order",
    "band_width",
    "colour_of_third_order_curved",
    "colour_of_fifth_order",
    "axial_colour_curved",
    "colour_of_third_order",
    "change_with_focus",
    "cylinders_change_with_focus",
    "exit_pupil",
    "pupil_squeeze",
    "decentred_elements",
    "pupil_stretch",
    "stop_ratios",
    "cylinders_fifth_spherical",
    "cylinders_fifth_coma",
    "cylinders_fifth_astigmatism",
    "fifth_order",
    "axial_colour",
    "cylinders_third_order",
)
"""In which their removal is tried; a term group that is not listed comes first."""
_REFINES = {
    "band_width": "axial_colour",
    "ninth_order": "seventh_order",
    "seventh_order": "fifth_order",
    "axial_colour_curved": "axial_colour",
    "colour_of_third_order": "axial_colour",
    "colour_of_third_order_curved": "axial_colour",
    "colour_of_fifth_order": "axial_colour",
}
"""The next terms of a series, and the term group before them: axial colour comes before
the colour of aberrations."""


class TermGroupSelection(NamedTuple):
    """Result of the selection of term groups.

    Attributes
    ----------
    term_groups : To keep.
    term_decisions : The decision on each candidate.
    chi_squared : Predicted for a fit with only these.
    """

    term_groups: tuple[TermGroup, ...]
    term_decisions: tuple[TermDecision, ...]
    chi_squared: float


def select_term_groups(
    stage: Stage, term_groups: tuple[TermGroup, ...]
) -> TermGroupSelection:
    """Remove, one after the other, the term groups that the photographs do not
    support."""
    always = indices_of(tuple(f for f in term_groups if not f.optional))
    always = always[stage.deviation[always] > 0]  # some are freed later
    tried = tuple(f for f in term_groups if f.optional)
    trial = trial_of(stage, always, indices_of(tried))
    kept = sorted(tried, key=_removal_place)
    full = trial.scores(indices_of(tuple(kept)))
    term_decisions = {}
    for term_group in list(kept):
        without = [f for f in kept if f is not term_group]
        less = trial.scores(indices_of(tuple(without)))
        gain = less.bic - full.bic
        held_out = 1 - full.held_out / max(less.held_out, 1e-300)
        supported = gain > _LEAST_BIC_GAIN and full.predicts_better_than(less)
        refined = any(_REFINES.get(other.name) == term_group.name for other in without)
        term_decision = TermDecision(term_group.name, supported, gain, held_out)
        if refined:
            term_decision = term_decision.with_override("terms that refine it are kept")
        term_decisions[term_group.name] = term_decision
        if not term_decision.kept:
            kept, full = without, less
    order = [f.name for f in term_groups]
    chosen = tuple(f for f in term_groups if not f.optional or f in kept)
    decisions = sorted(term_decisions.values(), key=lambda v: order.index(v.name))
    return TermGroupSelection(chosen, tuple(decisions), full.sum_of_squares)


def _removal_place(term_group: TermGroup) -> int:
    listed = term_group.name in _REMOVAL_ORDER
    return _REMOVAL_ORDER.index(term_group.name) if listed else -1


def trial_of(
    stage: Stage, always: Int[np.ndarray, " always"], tried: Int[np.ndarray, " tried"]
) -> Trial:
    """Every fold of the dots held out in turn, with the parameters of every model and
    those of the candidates."""
    deviation = np.where(stage.deviation > 0, stage.deviation, 1.0)
    return Trial(
        _statistics_of_folds(stage),
        precision=deviation**-2.0,
        offset=stage.parameters - stage.mean,
        always=always,
        tried=tried,
        stated=stage.stated_equations,
    )


def _statistics_of_folds(stage: Stage) -> list[Statistics]:
    """Of half the dots of one take each; folds without dots are left out."""
    matrix, gradient, chi_squared = (np.asarray(part) for part in stage.equations)
    seen = CELLS_PER_DOT * np.any(stage.weight > 0, (-2, -1)).sum(1)
    fold = folds_of(stage.dot_data)
    return [
        Statistics(
            matrix[k], gradient[k], float(chi_squared[k]), int(seen[fold == k].sum())
        )
        for k in np.unique(fold)
    ]

"""Which families the photographs ask for.

All from the normal equations of the largest model, in retrospect (`fit.trial`): a
family stays if the Bayesian information criterion improves by it and dots that the fit
did not see are predicted better. The highest orders are asked first, and what a family
that stays refines stays with it: a lens whose axial colour was left out, while the
colour of its third order stood for it, had red .02 px from where it lands.

Cells of one dot share what the model misses of it, so they do not count as so many
observations: `CELLS_PER_DOT` of each dot and channel do.

Reference: J. A. Nelder, J. R. Statist. Soc. A 140 (1977) 48, on marginality.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from lensfit.fitting.select import Verdict
from lensfit.fitting.trial import Statistics, Trial
from lensfit.fitting.wavefront.normal import Equations
from lensfit.fitting.wavefront.stages import Stage
from lensfit.fitting.wavefront.term_groups import Family, indices_of

CELLS_PER_DOT = 60
_LEAST_BIC_GAIN = 6.0
_ASKED_FIRST = (
    "ninth_order",
    "seventh_order",
    "colour_of_third_order_curved",
    "colour_of_fifth_order",
    "axial_colour_curved",
    "colour_of_third_order",
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
_REFINES = {
    "ninth_order": "seventh_order",
    "seventh_order": "fifth_order",
    "axial_colour_curved": "axial_colour",
    "colour_of_third_order": "axial_colour",
    "colour_of_third_order_curved": "axial_colour",
    "colour_of_fifth_order": "axial_colour",
}
"""The next terms of a series, and what they come after: every colour is in focus
somewhere before its aberrations differ."""


class FamilyChoice(NamedTuple):
    """Which families the photographs ask for.

    Attributes
    ----------
    families : To keep.
    verdicts : What came of each that was tried.
    chi_squared : Foreseen of a fit with only these.
    """

    families: tuple[Family, ...]
    verdicts: tuple[Verdict, ...]
    chi_squared: float


def choose(stage: Stage, families: tuple[Family, ...]) -> FamilyChoice:
    """Leave out, one after the other, what the photographs do not ask for."""
    always = indices_of(tuple(f for f in families if not f.tried))
    always = always[stage.deviation[always] > 0]  # some are freed later
    tried = tuple(f for f in families if f.tried)
    trial = trial_of(stage, always, indices_of(tried))
    kept = sorted(tried, key=lambda f: _ASKED_FIRST.index(f.name))
    verdicts = {}
    for family in list(kept):
        without = [f for f in kept if f is not family]
        full, less = (trial.scores(indices_of(tuple(m))) for m in (kept, without))
        gain = less.bic - full.bic
        held_out = 1 - full.held_out / max(less.held_out, 1e-300)
        asked = gain > _LEAST_BIC_GAIN and held_out > 0
        refined = any(_REFINES.get(other.name) == family.name for other in without)
        verdict = Verdict(family.name, asked, gain, held_out)
        if refined:
            verdict = verdict.kept_all_the_same("terms that refine it are asked for")
        verdicts[family.name] = verdict
        if not verdict.kept:
            kept = without
    order = [f.name for f in families]
    chosen = tuple(f for f in families if not f.tried or f in kept)
    told = sorted(verdicts.values(), key=lambda v: order.index(v.name))
    foreseen = trial.scores(indices_of(tuple(kept))).sum_of_squares
    return FamilyChoice(chosen, tuple(told), foreseen)


def trial_of(
    stage: Stage, always: Int[np.ndarray, " always"], tried: Int[np.ndarray, " tried"]
) -> Trial:
    """Both halves of the dots, with what is in every model and what may be."""
    deviation = np.where(stage.deviation > 0, stage.deviation, 1.0)
    return Trial(
        *_halves(stage.equations, stage),
        precision=deviation**-2.0,
        offset=stage.parameters - stage.mean,
        always=always,
        tried=tried,
        stated=stage.stated_equations,
    )


def _halves(equations: Equations, stage: Stage) -> tuple[Statistics, Statistics]:
    count = CELLS_PER_DOT * int(np.sum(np.any(stage.weight > 0, (-2, -1)))) // 2
    first, second = (
        Statistics(
            np.asarray(equations.matrix[half::2].sum(0)),
            np.asarray(equations.gradient[half::2].sum(0)),
            float(equations.chi_squared[half::2].sum()),
            count,
        )
        for half in (0, 1)
    )
    return first, second

"""The stages from the first solve to the last: what is free when, and on which dots.

1. `coarse`: smoothed by three cells, a few dots: defocus, clipping apertures, third
   order, from many starts.
2. `middle_fit`: smoothed by a cell and a half: fifth order.
3. `pixel_fit`: on full pixels, straight or by way of less smoothed ones: everything
   but what would diverge there (`term_groups.LAST`). `fine_fit`: on more dots; the
   blades of the iris are counted, and noise and robust weights are estimated again.
4. `fit_selected_term_groups`: only the term groups that model selection keeps.
5. `last_fit`: the rest freed; many rays.
"""

from dataclasses import replace

import numpy as np

from lensfit.fitting.select import TermDecision
from lensfit.fitting.wavefront.blades import EARLY_MISFIT_SHARE, fit_blades
from lensfit.fitting.wavefront.dot_data import rows_spread_over_takes, select_dots
from lensfit.fitting.wavefront.dot_weights import MODEL_SHARE, initial_weights
from lensfit.fitting.wavefront.multistart import (
    candidate_at,
    mirrored_candidate,
)
from lensfit.fitting.wavefront.stages import (
    Stage,
    best_of,
    chi_squared,
    recentre_patches,
    set_priors,
    smooth_stage,
    solve_stage,
    stage_on_dots,
    update_robust_weights,
)
from lensfit.fitting.wavefront.term_group_selection import select_term_groups
from lensfit.fitting.wavefront.term_groups import (
    FINE,
    LAST,
    MIDDLE,
    TermGroup,
    deviation_of,
)

_BETWEEN = 3
"""Passes between two updates of the robust weights."""
_COST_OVER_PREDICTED = 1.2
"""Largest cost over the predicted one, of a fit without the rejected term groups."""
_WORSE_THAN_PREDICTED = (
    "the fit without all rejected term groups was worse than predicted"
)
_MIDDLE_SMOOTHING = 1.5
"""Cells: half of the coarse solve's, for orders twice as fine."""
_FINE_SMOOTHING = 0.75
"""Half of that again. For a lens photographed wide open alone, a solve straight on full
pixels ended in a wrong local minimum; with this one in between the misfit was a
twentieth. Dots of less than a pixel are fitted better without. So both are tried."""
_DOTS_FOR_SIDE = 6
"""Of each photograph."""
_LAST_STEPS, _LAST_TOLERANCE = 24, 5e-4
_LAST_RAYS = 384
"""Of the Gauss-Newton matrix. Shifting all rays of the pupil together, rims included,
barely changes an image. With few rays the cost seems to rise steeply along that
direction: a fit would stop early, with too small an uncertainty. Since the true cost is
flat, the solve takes more passes and a finer tolerance: six passes ended too early on
most hard cases, twelve on the bundled shoot."""


def middle_fit(coarse: Stage, term_groups: tuple[TermGroup, ...]) -> Stage:
    """Fifth order on less smoothed dots."""
    stage = smooth_stage(coarse, _MIDDLE_SMOOTHING)
    stage = set_priors(stage, deviation_of(term_groups, stage.layout, MIDDLE))
    return solve_stage(solve_stage(stage))


def pixel_fit(stage: Stage, term_groups: tuple[TermGroup, ...]) -> Stage:
    """Everything on full pixels, from smoothed ones."""
    stage = set_priors(stage, deviation_of(term_groups, stage.layout, FINE))
    eased = solve_stage(recentre_patches(smooth_stage(stage, _FINE_SMOOTHING)))
    on_pixels = [recentre_patches(smooth_stage(start, 0.0)) for start in (stage, eased)]
    return best_of([solve_stage(start) for start in on_pixels])


def fine_fit(stage: Stage, rounds: int) -> Stage:
    """Blades as soon as the rest is nearly right, then robust weights.

    Parameters
    ----------
    stage : On full pixels of the dots to fit.
    rounds : Updates of the robust weights.
    """
    stage = solve_stage(fit_blades(stage, EARLY_MISFIT_SHARE))
    if not stage.blades:
        stage = fit_blades(stage)
    for _ in range(rounds):
        stage = update_robust_weights(solve_stage(stage, _BETWEEN), MODEL_SHARE)
    return solve_stage(stage)


def cost_at_initial_weights(stage: Stage) -> float:
    """Weighted sum of squared residuals, in weights that do not depend on a fit."""
    weight = initial_weights(stage.dot_data, MODEL_SHARE)
    return chi_squared(recentre_patches(replace(stage, weight=weight), 1))


def other_side_cost(stage: Stage) -> float:
    """Cost of the best lens on the other side of focus, over that of this one.

    Few dots of each photograph tell the two apart.
    """
    rows = rows_spread_over_takes(stage.dot_data, _DOTS_FOR_SIDE)
    few = stage_on_dots(stage, select_dots(stage.dot_data, rows))
    few = recentre_patches(few)
    other = mirrored_candidate(candidate_at(few)).stage
    return cost_at_initial_weights(other) / cost_at_initial_weights(few)


def fit_selected_term_groups(
    fine: Stage, term_groups: tuple[TermGroup, ...]
) -> tuple[Stage, tuple[TermGroup, ...], tuple[TermDecision, ...]]:
    """With only the selected term groups, if that fit is as good as predicted.

    Returns
    -------
    The fit, the term groups that are free in it, and the decision on each candidate.
    """
    kept, term_decisions, predicted = select_term_groups(fine, term_groups)
    deviation = deviation_of(kept, fine.layout, FINE)
    dropped = (fine.deviation > 0) & (deviation == 0)
    if not dropped.any():
        return fine, kept, term_decisions
    parameters = np.where(dropped, fine.mean, fine.parameters)
    stage = set_priors(replace(fine, parameters=parameters), deviation)
    stage = solve_stage(solve_stage(stage))
    # The prediction comes from second derivatives, which may be wrong far off; and a
    # solve that failed has a cost of NaN.
    if not chi_squared(stage) <= _COST_OVER_PREDICTED * predicted:
        return (
            fine,
            term_groups,
            tuple(v.with_override(_WORSE_THAN_PREDICTED) for v in term_decisions),
        )
    return stage, kept, term_decisions


def last_fit(stage: Stage, term_groups: tuple[TermGroup, ...]) -> Stage:
    """All selected term groups, with many rays."""
    stage = set_priors(stage, deviation_of(term_groups, stage.layout, LAST))
    stage = replace(stage, ray_groups=_LAST_RAYS // stage.points.design)
    # One more pass, from where the patches have been moved to.
    return recentre_patches(solve_stage(stage, _LAST_STEPS, _LAST_TOLERANCE), 1)

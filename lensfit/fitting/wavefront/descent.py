"""The stages from the first solve to the last: what is free when, and on which dots.

1. `coarse`: smoothed by three cells, a few dots: defocus, clipping apertures, third
   order, from many starts.
2. `middle_fit`: smoothed by a cell and a half: fifth order.
3. `pixel_fit`: on full pixels, straight or by way of less smoothed ones: everything
   but what would diverge there (`term_groups.LAST`). `fine_fit`: on more dots; the
   blades of the iris are counted, and noise and robust weights are estimated again.
4. `fit_selected_term_groups`: only the term groups that model selection keeps.
5. `last_fit`: the rest freed; many rays.

The number of blades is seen in defocused dots near the axis, whose edge is the edge of
the pupil. For every number the corners are rotated to where they fit the photographs
best; the one with the smallest misfit is kept if it is clearly better than a round
iris (`fit_blades`).
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Int

from lensfit.fitting.select import TermDecision
from lensfit.fitting.wavefront.dot_data import (
    WIDE_OPEN,
    rows_spread_over_takes,
    select_dots,
)
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

BLADE_COUNTS = (5, 6, 7, 8, 9, 10, 11, 12)
_TURNS = 3
_DOTS = 16
_FINALISTS = 3
FINAL_MISFIT_SHARE, EARLY_MISFIT_SHARE = 0.95, 0.8
"""Largest misfit with blades over that of a round iris: where all the rest is fitted,
and before that."""
_SMOOTHING = 0.8
_DEVIATION = (3.0, 1.0)


def fit_blades(stage: Stage, share: float = FINAL_MISFIT_SHARE) -> Stage:
    """The same with the number and rotation of blades that fit the photographs best.

    Parameters
    ----------
    share : Largest misfit with blades over that of a round iris.
    """
    rows = _iris_rows(stage)
    if not len(rows):
        return stage
    where = stage.layout.blocks["iris"]
    rotation, curvature = where.start + 1, where.start + 2
    deviation = np.zeros(stage.layout.size)
    deviation[[rotation, curvature]] = _DEVIATION
    some = replace(
        stage,
        dot_data=select_dots(stage.dot_data, rows),
        corner_mm=stage.corner_mm[rows],
        weight=stage.weight[rows],
    )
    some = set_priors(smooth_stage(some, _SMOOTHING), deviation)
    turned = [
        best_of(_rotation_trials(some, count, rotation)) for count in BLADE_COUNTS
    ]
    turned.sort(key=chi_squared)
    best = best_of([solve_stage(trial, 6) for trial in turned[:_FINALISTS]])
    if chi_squared(best) > share * chi_squared(solve_stage(some, 1)):
        return stage
    iris = best.parameters[where].copy()
    iris[1] = np.mod(iris[1], 2 * np.pi / best.blades)
    parameters, mean = stage.parameters.copy(), stage.mean.copy()
    parameters[where] = mean[where] = iris
    return replace(stage, parameters=parameters, mean=mean, blades=best.blades)


def _rotation_trials(stage: Stage, count: int, rotation: int) -> list[Stage]:
    """One pass for each of a few rotations of the corners."""
    found = []
    for turn in range(_TURNS):
        parameters = stage.parameters.copy()
        parameters[rotation] = 2 * np.pi / count * turn / _TURNS
        found.append(
            solve_stage(replace(stage, blades=count, parameters=parameters), 1)
        )
    return found


def _iris_rows(stage: Stage) -> Int[np.ndarray, " rows"]:
    """Dots that show the iris: stopped down, most defocused, nearest the axis."""
    dot_data = stage.dot_data
    stopped = dot_data.dots.stop_radius < 1 / WIDE_OPEN
    if not stopped.any():
        return np.array([], int)
    defocus = np.abs(stage.parameters[stage.layout.blocks["defocus"]])
    size = defocus[dot_data.dots.group] * dot_data.dots.stop_radius
    size = size / dot_data.dots.cell_mm[:, 0]
    size = np.where(stopped, size, 0.0)
    blurred = np.flatnonzero(size > 0.5 * size.max())
    radius = np.hypot(*dot_data.dots.field_mm[blurred].T)
    return np.sort(blurred[np.argsort(radius)[:_DOTS]])


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
_LAST_STEPS, _LAST_TOLERANCE = 24, 1e-4
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

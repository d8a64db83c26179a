"""Misfit of the images of dots, for dots in the fit and for dots left out of it.

Relative errors of a dot's image: the root of the sum of squared residuals over that of
the image's own squares, so that 0.05 is an error of a twentieth.

How well a fit predicts dots and views that it left out follows from the normal
equations where it ended (`lensfit.fitting.trial`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lensfit.fitting.wavefront.dot_weights import relative_misfit
from lensfit.fitting.wavefront.stages import Stage
from lensfit.fitting.wavefront.term_group_selection import trial_of
from lensfit.fitting.wavefront.term_groups import TermGroup, indices_of


def held_out_take(
    stage: Stage, term_groups: tuple[TermGroup, ...], take: int
) -> float | None:
    """Misfit of a take if it were held out, over its misfit now; without a new fit.

    Its own defocus, where no other take shares it, is taken as known. None where the
    prediction is meaningless: the other takes do not determine the fit.
    """
    free = indices_of(term_groups)
    matrix, gradient, chi_squared = stage.equations
    left = [f % len(chi_squared) for f in (2 * take, 2 * take + 1)]
    # Of very many takes some share their folds, and are left out together.
    mine = np.isin(2 * stage.dot_data.take % len(chi_squared), left)
    free = free[~np.isin(free, _own_defocus(stage, mine))]
    rest = np.setdiff1d(np.arange(len(chi_squared)), left)
    precision = stage.precision[free]
    square = np.ix_(free, free)
    inner = matrix[rest].sum(0)[square] + stage.prior_matrix(free, precision**-0.5)
    slope = gradient[rest].sum(0)[free] + stage.stated_equations.gradient[free]
    slope = slope + precision * (stage.parameters - stage.mean)[free]
    of_take = matrix[left].sum(0)[square]
    pull = gradient[left].sum(0)[free]

    def misfit(step: np.ndarray) -> float:
        """Of the take, to second order."""
        return float(chi_squared[left].sum() + 2 * pull @ step + step @ of_take @ step)

    # A solve ends a little before its minimum: both misfits are taken at their own
    # minima, so that holding a take out never lowers its misfit.
    now = misfit(-np.linalg.solve(inner + of_take, slope + pull))
    then = misfit(-np.linalg.solve(inner, slope))
    return float(np.sqrt(then / max(now, 1e-300))) if then > 0 else None


def _own_defocus(stage: Stage, mine: Bool[np.ndarray, " dots"]) -> list[int]:
    """Parameters of the defocus that no other dots share."""
    group, blocks = stage.dot_data.dots.group, stage.layout.blocks
    own = np.setdiff1d(group[mine], group[~mine])
    starts = [
        blocks[name].start
        for name in ("defocus", "astigmatic_offset")
        if name in blocks
    ]
    return [start + int(g) for start in starts for g in own]


def held_out_dots(stage: Stage, term_groups: tuple[TermGroup, ...]) -> float:
    """Misfit of dots held out, a fold at a time, over the misfit of all; NaN where the
    others leave the lens so free that it ends where the equations do not hold."""
    free = indices_of(term_groups)
    trial = trial_of(stage, free, np.array([], int))
    total = float(np.sum(stage.equations.chi_squared))
    held_out = trial.scores(np.array([], int)).held_out
    return float(np.sqrt(held_out / max(total, 1e-300))) if held_out > 0 else np.nan


class Misfit(NamedTuple):
    """Relative errors of dots' images.

    Attributes
    ----------
    take_misfits : Median of each take.
    held_out_dots : Median of takes, for dots that were held out.
    held_out_take : Of each take if it were held out; None where the other takes
        do not determine the fit.
    """

    take_misfits: Float[np.ndarray, " takes"]
    held_out_dots: float
    held_out_take: tuple[float | None, ...]

    @property
    def median(self) -> float:
        """Of the takes."""
        return float(np.median(self.take_misfits))


def misfit_of(stage: Stage, term_groups: tuple[TermGroup, ...]) -> Misfit:
    """Misfit where a solve ended."""
    each = relative_misfit(stage.dot_data, stage.residual, stage.nuisance[..., 1])
    takes = range(len(stage.dot_data.photographs))
    take_misfits = np.array(
        [np.nanmedian(each[stage.dot_data.take == k]) for k in takes]
    )
    ratios = [
        held_out_take(stage, term_groups, k) if len(takes) > 1 else None for k in takes
    ]
    return Misfit(
        take_misfits,
        float(np.median(take_misfits)) * held_out_dots(stage, term_groups),
        tuple(
            None if ratio is None else ratio * float(now)
            for ratio, now in zip(ratios, take_misfits, strict=True)
        ),
    )

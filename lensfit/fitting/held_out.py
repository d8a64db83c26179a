"""Random halves of the detections: errors held out, and normal equations of each.

The held-out error is a cross-validation: model and poses are fitted to a random half of
every photograph's detections and predict the other half, for several random partitions.

Model selection does the same with the normal equations of two halves: the held-out
error of a model is computed on the half that it was not fitted to. The sum of both
halves is the equations of all detections, which the uncertainty is computed from.
"""

import numpy as np
from jaxtyping import Bool, Float

from lensfit.fitting.adjust import (
    COLLINEAR_DAMPING,
    Adjustment,
    adjustment_at_solution,
    equations_at,
    problem_of,
    stated_equations,
)
from lensfit.fitting.trial import Statistics
from lensfit.fitting.view_stack import noise_mm2, residuals_of

HELD_OUT_SEEDS = (0, 1, 2)
_MOST_STEPS = 6


def squared_px(adjustment: Adjustment) -> Float[np.ndarray, "views detections"]:
    """Squared residual of every detection, square pixels."""
    squared = np.sum(adjustment.residual_mm() ** 2, -1)
    return squared / adjustment.stack.mm_per_px[:, None] ** 2


def rms(squared: np.ndarray, chosen: Bool[np.ndarray, "..."]) -> float:
    """Root mean square over the chosen detections; NaN if there are none."""
    return float(np.sqrt(np.mean(squared[chosen]))) if chosen.any() else float("nan")


def held_out_error_px(adjustment: Adjustment) -> tuple[float, tuple[float, ...]]:
    """Root mean square error on the half of each view that was not fitted.

    Returns
    -------
    The mean over seeds, for all photographs and for each.
    """
    whole, each = [], []
    for seed in HELD_OUT_SEEDS:
        fitted, seen = fitted_to_half(adjustment, seed)
        squared = squared_px(fitted)
        unseen = adjustment.used & ~seen
        whole.append(rms(squared, unseen))
        each.append([rms(s, u) for s, u in zip(squared, unseen, strict=True)])
    return float(np.mean(whole)), tuple(np.mean(each, axis=0).tolist())


def fitted_to_half(
    adjustment: Adjustment, seed: int
) -> tuple[Adjustment, Bool[np.ndarray, "views detections"]]:
    """The same model, fitted to a random half of the detections, and which half."""
    seen = np.random.default_rng(seed).random(adjustment.weight.shape) < 0.5
    problem = problem_of(adjustment, np.where(seen, adjustment.weight, 0.0))
    return adjustment_at_solution(
        adjustment, problem, _MOST_STEPS, COLLINEAR_DAMPING
    ), seen


def explained_by(effect_px: float, adjustment: Adjustment) -> float:
    """Chi-squared of a displacement of this rms over the detections, at their mean
    variance: what a term explains that follows it, what an error adds."""
    variance = noise_mm2(adjustment.stack) + adjustment.model_variance_mm2[:, None]
    mean_mm2 = np.mean(variance[adjustment.used])
    px_per_deviation = float(np.sqrt(mean_mm2) / adjustment.stack.mm_per_px.mean())
    return int(adjustment.used.sum()) * (effect_px / px_per_deviation) ** 2


def stated_statistics(adjustment: Adjustment) -> Statistics:
    """Normal equations of the stated values, at the present parameters."""
    here = adjustment.parameters
    matrix, vector, constant = map(np.asarray, stated_equations(adjustment))
    turned = matrix @ here
    squares = float(here @ (turned - 2 * vector) + constant)
    return Statistics(matrix, turned - vector, squares, 0)


def halves_of(adjustment: Adjustment) -> tuple[Statistics, Statistics]:
    """Normal equations of the full model for two random halves of the detections."""
    here = equations_at(adjustment)
    matrix, gradient = np.asarray(here.matrix), np.asarray(here.gradient)
    squares = np.asarray(here.chi_squared)
    chunking = adjustment.stack.chunking
    residuals = residuals_of(adjustment.stack) * adjustment.used
    counts = chunking.in_chunks(residuals) * chunking.real
    one, other = (
        Statistics(
            matrix[half],
            gradient[half],
            float(squares[half]),
            int(counts[:, half::2].sum()),
        )
        for half in (0, 1)
    )
    return one, other

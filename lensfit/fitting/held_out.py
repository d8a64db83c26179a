"""Errors on the photographs: of fitted and of held-out detections.

The held-out error is a cross-validation: model and poses are fitted to a random half of
every photograph's detections and predict the other half, for several random partitions.
"""

import numpy as np
from jaxtyping import Bool, Float

from lensfit.fitting.adjust import (
    COLLINEAR_DAMPING,
    Adjustment,
    adjustment_at_solution,
    problem_of,
)

HELD_OUT_SEEDS = (0, 1, 2)
_MOST_STEPS = 6


def squared_px(adjustment: Adjustment) -> Float[np.ndarray, "views detections"]:
    """Squared residual of every detection, square pixels."""
    squared = np.sum(adjustment.residual_mm() ** 2, -1)
    return squared / adjustment.stack.mm_per_px[:, None] ** 2


def rms(squared: np.ndarray, chosen: Bool[np.ndarray, "..."]) -> float:
    """Root mean square over the chosen detections; NaN if there are none."""
    return float(np.sqrt(np.mean(squared[chosen]))) if chosen.any() else float("nan")


def held_out_error_px(
    adjustment: Adjustment, seeds: tuple[int, ...] = HELD_OUT_SEEDS
) -> tuple[float, tuple[float, ...]]:
    """Root mean square error on the half of each view that was not fitted.

    Returns
    -------
    The mean over seeds, for all photographs and for each.
    """
    whole, each = [], []
    for seed in seeds:
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

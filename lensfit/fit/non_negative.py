"""Robust least squares with unknowns that may not be negative.

Values come in sets, such as photographs, each with a scatter of its own that nobody
told. Cauchy weights keep outliers from having a say; scatter and weights are found in
turns. The covariance is the sandwich estimate, which takes residuals as they are, and
an error of all values together that no residual shows.
Some values may be expected rather than observed: they have the deviation they are told
with, whatever is left of them.

Reference: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems (1974), ch. 23;
H. White, Econometrica 48 (1980) 817.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import nnls

_ROUNDS = 6
_CAUCHY = 3.0
"""Scatters at which a value weighs half."""
_OF_NORMAL = 0.6745
"""Median distance from the mean of a normal distribution, in standard deviations."""


class Expected(NamedTuple):
    """Values that nobody observed.

    Attributes
    ----------
    design : As for observed ones.
    deviation : Of each.
    """

    design: Float[np.ndarray, "expected columns"]
    values: Float[np.ndarray, " expected"]
    deviation: Float[np.ndarray, " expected"]


class NonNegative(NamedTuple):
    """What was found.

    Attributes
    ----------
    solution : Of every column.
    covariance : Of the first columns, as if they might have either sign: that they may
        not is no knowledge of the values.
    deviance : Twice the negative logarithm of the likelihood, but for a constant.
    """

    solution: Float[np.ndarray, " columns"]
    covariance: Float[np.ndarray, "first first"]
    deviance: float


def robust_non_negative(
    design: Float[np.ndarray, "values columns"],
    values: Float[np.ndarray, " values"],
    member: Int[np.ndarray, " values"],
    first: int,
    least_scatter: float,
    expected: Expected,
    systematic: float = 0.0,
) -> NonNegative:
    """Least squares with non-negative unknowns and Cauchy weights.

    Parameters
    ----------
    member : The set of every value, counted from 0 without gaps.
    first : How many columns the covariance is of; the others repeat some of them with
        the other sign.
    least_scatter : Of any set.
    systematic : Root mean square of what the columns may take up of errors that all
        values share.
    """
    weight = np.full(len(values), least_scatter**-2.0)
    certain = 1 / expected.deviation
    rows = np.concatenate([design, expected.design])
    wanted = np.concatenate([values, expected.values])
    for _ in range(_ROUNDS):
        root = np.concatenate([np.sqrt(weight), certain])
        solution, _ = nnls(rows * root[:, None], wanted * root)
        residual = values - design @ solution
        scatter = _scatter_of_each(residual, member, least_scatter)
        ratio = (residual / (_CAUCHY * scatter)) ** 2
        weight = 1 / (1 + ratio) / scatter**2
    pull = np.concatenate([weight * residual, certain])
    every = np.concatenate([weight, certain**2])
    covariance = _covariance(rows[:, :first], pull, every)
    if systematic:
        explained = systematic**2 * weight.sum()
        known = np.concatenate([weight * (first / explained), certain**2])
        moves = _solving(rows[:, :first], known)[:, : len(weight)]
        covariance += moves @ moves.T
    off = (expected.values - expected.design @ solution) * certain
    deviance = np.sum(_CAUCHY**2 * np.log1p(ratio) + 2 * np.log(scatter)) + off @ off
    return NonNegative(solution, covariance, float(deviance))


def _scatter_of_each(
    residual: np.ndarray, member: np.ndarray, least: float
) -> Float[np.ndarray, " values"]:
    """Of the set that a value is of."""
    of_sets = [
        np.median(np.abs(residual[member == k])) / _OF_NORMAL
        for k in range(member.max() + 1)
    ]
    return np.array(of_sets)[member] + least


def _covariance(
    design: np.ndarray, pull: np.ndarray, weight: np.ndarray
) -> Float[np.ndarray, "columns columns"]:
    """Sandwich over the values."""
    moves = _solving(design, weight) * (pull / np.sqrt(weight))
    factor = len(design) / max(len(design) - design.shape[1], 1)
    return moves @ moves.T * factor


def _solving(design: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Not from the normal equations: with many terms they are nearly singular."""
    return np.linalg.pinv(design * np.sqrt(weight)[:, None])

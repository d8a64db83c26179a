"""Robust non-negative least squares.

Values come in sets, such as photographs, each with an unknown scatter and an unknown
level. Outliers are down-weighted by a Cauchy loss; scatter and weights are estimated
alternately. Levels are eliminated before the solve: values are taken relative to the
weighted mean of their set. The covariance is the sandwich estimate, with the actual
residuals and the derivative of the loss, plus a systematic error common to all values.
Some values may be expected rather than observed: their errors are given, and do not
depend on their residuals.

Reference: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems (1974), ch. 23;
P. J. Huber, Robust Statistics (1981), ch. 7; on the partial regression, M. C. Lovell,
J. Amer. Statist. Assoc. 58 (1963) 993.
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
_LEAST_BREAD = 0.1
"""Of the weights; of half of all values outliers, by no more than this is a deviation
raised."""


class Expected(NamedTuple):
    """Values that nobody observed, whatever the levels of the sets.

    Attributes
    ----------
    design : As for observed ones.
    deviation : Which say how much each counts.
    covariance : Of their errors, which may be one error of all.
    """

    design: Float[np.ndarray, "expected columns"]
    values: Float[np.ndarray, " expected"]
    deviation: Float[np.ndarray, " expected"]
    covariance: Float[np.ndarray, "expected expected"]


class NonNegative(NamedTuple):
    """What was found.

    Attributes
    ----------
    solution : Of every column.
    covariance : As if they might have either sign: that they may not is no knowledge of
        the values.
    deviance : Twice the negative logarithm of the likelihood, but for a constant.
    """

    solution: Float[np.ndarray, " columns"]
    covariance: Float[np.ndarray, "columns columns"]
    deviance: float


def robust_non_negative(
    design: Float[np.ndarray, "values columns"],
    values: Float[np.ndarray, " values"],
    member: Int[np.ndarray, " values"],
    least_scatter: float,
    expected: Expected,
    systematic: float = 0.0,
) -> NonNegative:
    """Least squares with non-negative unknowns and Cauchy weights.

    Parameters
    ----------
    member : The set of every value, counted from 0 without gaps.
    least_scatter : Of any set.
    systematic : Root mean square of what the columns may take up of errors that all
        values share.
    """
    weight = np.full(len(values), least_scatter**-2.0)
    certain = expected.design / expected.deviation[:, None]
    expected_values = expected.values / expected.deviation
    both = np.column_stack([design, values])
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        free_of_levels = _from_levels(both, weight, member)
        rows, wanted = free_of_levels[:, :-1], free_of_levels[:, -1]
        seen = rows * root[:, None]
        solution, _ = nnls(
            np.concatenate([seen, certain]),
            np.concatenate([wanted * root, expected_values]),
        )
        residual = wanted - rows @ solution
        scatter = _scatter_of_each(residual, member, least_scatter)
        ratio = (residual / (_CAUCHY * scatter)) ** 2
        weight = 1 / (1 + ratio) / scatter**2
    root = np.sqrt(weight)
    seen = _from_levels(design, weight, member) * root[:, None]
    # Not from the normal equations: with many terms they are nearly singular.
    moves = np.linalg.pinv(np.concatenate([seen, certain]))
    observed, assumed = np.split(moves, [len(values)], axis=1)
    unknowns = design.shape[1] + member.max() + 1
    pulled = observed * (residual * root) * _huber(ratio, unknowns, weight)
    assumed = assumed / expected.deviation
    shared = systematic**2 * weight.sum() / design.shape[1]
    covariance = pulled @ pulled.T + shared * (observed @ observed.T)
    covariance += assumed @ expected.covariance @ assumed.T
    off = expected_values - certain @ solution
    deviance = np.sum(_CAUCHY**2 * np.log1p(ratio) + 2 * np.log(scatter)) + off @ off
    return NonNegative(solution, covariance, float(deviance))


def _from_levels(
    columns: Float[np.ndarray, "values columns"],
    weight: Float[np.ndarray, " values"],
    member: Int[np.ndarray, " values"],
) -> Float[np.ndarray, "values columns"]:
    """Less the weighted mean of the set."""
    each = weight[:, None] * (member[:, None] == np.arange(member.max() + 1))
    return columns - ((each.T @ columns) / each.sum(0)[:, None])[member]


def _scatter_of_each(
    residual: np.ndarray, member: np.ndarray, least: float
) -> Float[np.ndarray, " values"]:
    """Of the set that a value is of."""
    of_sets = [
        np.median(np.abs(residual[member == k])) / _OF_NORMAL
        for k in range(member.max() + 1)
    ]
    return np.array(of_sets)[member] + least


def _huber(ratio: np.ndarray, unknowns: int, weight: np.ndarray) -> float:
    """Weight over the slope of the pull, and the factor for few values."""
    slope = weight * (1 - ratio) / (1 + ratio)
    bread = max(slope.sum() / weight.sum(), _LEAST_BREAD)
    return float(np.sqrt(len(ratio) / max(len(ratio) - unknowns, 1)) / bread)

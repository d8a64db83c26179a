"""Linearised fits of many sub-models, from the normal equations of the full model.

All sub-models share some parameters, above all the poses. These are eliminated once.
What remains are quadratic forms in the candidate parameters: the cost on all
detections, and for each part of them its cost at the solution of the others. The fit of
a sub-model is then a solve with a sub-block of small matrices.

Parts that are small predict better than halves whether a term helps: half of six
corners of a photograph can leave a term free that all of them determine.

Reference: S. Arlot and A. Celisse, Statistics Surveys 4 (2010) 40, on how bias and
variance of cross-validation fall with the number of parts; T. Hastie, R. Tibshirani and
J. Friedman, The Elements of Statistical Learning (2009), 7.10, on its standard error.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve

_JITTERS = 1e-12, 1e-9, 1e-7, 1e-5
"""Relative increments of the diagonal, tried in this order."""


class Statistics(NamedTuple):
    """Normal equations of the full model for one set of detections.

    `count` is the number of residuals.
    """

    matrix: Float[np.ndarray, "parameters parameters"]
    gradient: Float[np.ndarray, " parameters"]
    sum_of_squares: float
    count: int

    def without(self, part: "Statistics") -> "Statistics":
        """Of the detections that are not in a part."""
        return Statistics(
            self.matrix - part.matrix,
            self.gradient - part.gradient,
            self.sum_of_squares - part.sum_of_squares,
            self.count - part.count,
        )


def together(parts: Sequence[Statistics]) -> Statistics:
    """Of all detections of some parts."""
    return Statistics(
        np.sum([part.matrix for part in parts], 0),
        np.sum([part.gradient for part in parts], 0),
        sum(part.sum_of_squares for part in parts),
        sum(part.count for part in parts),
    )


class Scores(NamedTuple):
    """Scores of a model: sum of squares on all detections, Bayesian information
    criterion, and sum of squares on every part where it was held out."""

    sum_of_squares: float
    bic: float
    held_out_of_parts: Float[np.ndarray, " parts"]

    @property
    def held_out(self) -> float:
        """Of all parts."""
        return float(self.held_out_of_parts.sum())

    def predicts_better_than(self, other: "Scores") -> bool:
        """Whether parts that were held out are predicted better, by more than the
        standard error of that."""
        fall = other.held_out_of_parts - self.held_out_of_parts
        spread = fall.std(ddof=1) if len(fall) > 1 else 0.0
        return bool(fall.mean() > spread / np.sqrt(len(fall)))


class _Form(NamedTuple):
    """constant + 2 linear.z + z.square.z"""

    constant: float
    linear: Float[np.ndarray, " tried"]
    square: Float[np.ndarray, "tried tried"]

    def at(self, chosen: np.ndarray, z: np.ndarray) -> float:
        square = self.square[np.ix_(chosen, chosen)]
        return float(self.constant + 2 * self.linear[chosen] @ z + z @ square @ z)


class _Reduced(NamedTuple):
    """The solution for a set of detections as a function of the candidate parameters.

    The step of all parameters is `origin` + `turn` z. Here z is the difference of the
    candidate parameters from their prior mean; the shared ones minimise the cost.
    """

    origin: Float[np.ndarray, " parameters"]
    turn: Float[np.ndarray, "parameters tried"]
    cost: _Form

    def solution(self, chosen: np.ndarray) -> np.ndarray:
        """The z of least cost, prior included, with all other candidates at zero."""
        square = self.cost.square[np.ix_(chosen, chosen)]
        return -cho_solve(_factor(square), self.cost.linear[chosen])


class Trial:
    """Scores of the models that consist of `always` and any subset of `tried`.

    Parameters
    ----------
    parts : Equations of parts of the detections, at the same parameters; each is held
        out in turn.
    precision : Prior precision of every parameter.
    offset : Those parameters minus their prior mean.
    always, tried : Disjoint indices; every other parameter returns to its prior mean.
    stated : Equations of stated values: part of every solution, and of no cost.

    Raises
    ------
    ValueError : A parameter is in both `always` and `tried`.
    """

    def __init__(
        self,
        parts: Sequence[Statistics],
        precision: Float[np.ndarray, " parameters"],
        offset: Float[np.ndarray, " parameters"],
        always: Int[np.ndarray, " always"],
        tried: Int[np.ndarray, " tried"],
        stated: Statistics | None = None,
    ):
        if np.intersect1d(always, tried).size:
            raise ValueError("a parameter of every model cannot be tried as well")
        whole = together(parts)
        self._count = whole.count
        self._always, self._tried = len(always), np.asarray(tried, int)

        def reduced(some: Statistics) -> _Reduced:
            some = _with_stated(some, stated)
            indices = np.asarray(always, int), self._tried
            return _reduced_statistics(some, precision, offset, *indices)

        self._whole = reduced(whole)
        self._total = _restricted_form(whole, self._whole)
        self._unseen = []
        for part in parts:
            solved = reduced(whole.without(part))
            self._unseen.append((solved, _restricted_form(part, solved)))

    def scores(self, indices: Int[np.ndarray, " chosen"]) -> Scores:
        """Scores of the model whose candidate parameters are `indices`."""
        chosen = np.flatnonzero(np.isin(self._tried, indices))
        total = self._total.at(chosen, self._whole.solution(chosen))
        free = self._always + len(chosen)
        bic = self._count * np.log(max(total, 1e-300)) + free * np.log(self._count)
        held_out = [
            form.at(chosen, others.solution(chosen)) for others, form in self._unseen
        ]
        return Scores(total, float(bic), np.array(held_out))

    def step(self, indices: Int[np.ndarray, " chosen"]) -> np.ndarray:
        """Change of all parameters to the solution of that model, on all detections."""
        chosen = np.flatnonzero(np.isin(self._tried, indices))
        turned = self._whole.turn[:, chosen] @ self._whole.solution(chosen)
        return self._whole.origin + turned


def _with_stated(statistics: Statistics, stated: Statistics | None) -> Statistics:
    if stated is None:
        return statistics
    return statistics._replace(
        matrix=statistics.matrix + stated.matrix,
        gradient=statistics.gradient + stated.gradient,
    )


def _factor(square: Float[np.ndarray, "some some"]) -> tuple[np.ndarray, bool]:
    """Cholesky factor for `cho_solve`.

    Matrices summed in single precision may fail to be positive definite by rounding;
    the diagonal is then increased as little as is needed.

    Raises
    ------
    ValueError : The matrix is indefinite beyond rounding, or not finite.
    """
    for jitter in _JITTERS if np.isfinite(square).all() else ():
        held = square.copy()
        held[np.diag_indices_from(held)] *= 1 + jitter
        try:
            return cho_factor(held)
        except np.linalg.LinAlgError:
            continue
    raise ValueError("the detections leave the model undetermined")


def _reduced_statistics(
    statistics: Statistics,
    precision: np.ndarray,
    offset: np.ndarray,
    always: np.ndarray,
    tried: np.ndarray,
) -> _Reduced:
    """Eliminate `always`; all other parameters start from their prior mean."""
    home = -offset.copy()
    home[always] = 0.0
    gradient = statistics.gradient + statistics.matrix @ home
    gradient = gradient + precision * (offset + home)
    matrix = statistics.matrix
    inner = matrix[np.ix_(always, always)].copy()
    inner[np.diag_indices_from(inner)] += precision[always]
    factor = _factor(inner)
    rest = cho_solve(factor, matrix[np.ix_(always, tried)])
    origin, turn = home, np.zeros((len(offset), len(tried)))
    origin[always] = -cho_solve(factor, gradient[always])
    turn[always] = -rest
    turn[tried, np.arange(len(tried))] = 1.0
    square = matrix[np.ix_(tried, tried)] - matrix[np.ix_(tried, always)] @ rest
    square[np.diag_indices_from(square)] += precision[tried]
    linear = gradient[tried] - rest.T @ gradient[always]
    return _Reduced(origin, turn, _Form(0.0, linear, (square + square.T) / 2))


def _restricted_form(statistics: Statistics, reduced: _Reduced) -> _Form:
    """Cost of the solution for one set of detections on another set, without priors."""
    origin, turn = reduced.origin, reduced.turn
    slope = statistics.gradient + statistics.matrix @ origin
    constant = statistics.sum_of_squares + (statistics.gradient + slope) @ origin
    square = turn.T @ (statistics.matrix @ turn)
    return _Form(float(constant), turn.T @ slope, square)

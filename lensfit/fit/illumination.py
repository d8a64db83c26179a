"""Fall-off from how bright the marks are, for every f-number by itself.

A bright dot sends as much light wherever it is, spread over the area of its image: its
flux divided by the magnification of that area is the illumination there. A line's
flux per length is divided by its magnified width. The bright field around dark marks is
proportional to the illumination times the light that fell on the chart.

The logarithm is fitted by a non-increasing Bernstein polynomial
(`lensfit.optics.falloff`) with one gain for each photograph and channel: least squares
with non-negative steps, weighted robustly. Clipping by a rim sets in with a kink, which
takes more terms than natural fall-off; their number is chosen by evidence. An unevenly
lit chart cannot be told from fall-off, unless photographs at another orientation
disagree.

Photographs scatter by what they went through: colours of sharp dots in a JPEG, whose
colour planes are halved, by ten times as much as those of blurred ones. Each weighs as
its own scatter says. Where dots were photographed lines have no say: what is read of a
line ends at the same distance everywhere, and a corner's blur goes beyond.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls
from scipy.stats import binom

from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT
from lensfit.fit.adjust import Adjustment
from lensfit.fit.take import Take

TERMS = (5, 8, 12, 16)
"""Numbers of terms to choose from."""
_LEAST_BIC_GAIN = 10.0
_LEAST_SCATTER = 1e-4
"""Of a photograph's logarithms; no detector is better."""
_FEWEST_MARKS = 30
_ROUNDS = 6
_STEP = 1e-3
"""Of differences, half boards."""


@dataclass(frozen=True, eq=False)
class FallOffFit:
    """Fall-off of three channels at one f-number.

    Attributes
    ----------
    f_number : None when nobody said.
    control : b_1 ... b_n of r, g and b.
    valid_radius_mm : Largest radius measured.
    covariance : Of each channel's control values.
    """

    f_number: float | None
    control: Float[np.ndarray, "3 terms"]
    valid_radius_mm: float
    covariance: Float[np.ndarray, "3 terms terms"]

    def deviation(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "3 points"]:
        """Standard deviation of the relative illumination of r, g and b.

        Beyond the measured radius that at its edge.
        """
        terms = self._terms_at(radius_mm)
        loss = terms @ self.control.T
        return np.exp(-loss.T) * self._of_terms(terms)

    def deviation_about_mean(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "3 points"]:
        """Standard deviation of the logarithm of the illumination, less its mean over
        these points: what no exposure would undo."""
        terms = self._terms_at(radius_mm)
        return self._of_terms(terms - terms.mean(0))

    def _terms_at(self, radius_mm: np.ndarray) -> np.ndarray:
        s = np.minimum(radius_mm / self.valid_radius_mm, 1.0) ** 2
        return _bernstein(s, self.control.shape[1])

    def _of_terms(self, terms: np.ndarray) -> np.ndarray:
        variance = np.einsum("pi,cij,pj->cp", terms, self.covariance, terms)
        return np.sqrt(np.maximum(variance, 0.0))


def fit_illumination(
    takes: tuple[Take, ...], adjustment: Adjustment, principal_point_mm: np.ndarray
) -> list[FallOffFit]:
    """One fall-off for each f-number among the takes, widest first."""
    stretch = area_stretch(adjustment)
    observed = adjustment.stack.observed_mm
    numbers = sorted({t.f_number for t in takes}, key=lambda n: n or 0.0)
    found = []
    for number in numbers:
        rows = [
            _rows(t, stretch[k], observed[k] - principal_point_mm, adjustment.used[k])
            for k, t in enumerate(takes)
            if t.f_number == number
        ]
        rows = _best_told([row for row in rows if len(row.squared)])
        if _count(rows) >= _FEWEST_MARKS:
            found.append(_fit(number, rows))
    return found


def area_stretch(adjustment: Adjustment) -> Float[np.ndarray, "views marks 2 2"]:
    """d sensor mm / d board mm at every mark.

    Central differences over a thousandth of the half board, good to a millionth: the
    program that predicts marks serves here too.
    """
    half_mm = np.asarray(adjustment.stack.view.half_board_mm)[:, None]
    board = adjustment.stack.board
    columns = [
        (adjustment.predicted_mm(board + step) - adjustment.predicted_mm(board - step))
        / (2 * _STEP)
        for step in _STEP * np.eye(2)
    ]
    return np.stack(columns, -1) / half_mm[:, :, None]


class _Rows(NamedTuple):
    """Squared radius and log brightness of the marks of one take."""

    squared: Float[np.ndarray, " marks"]
    brightness: Float[np.ndarray, "marks 3"]
    lines: bool


def _best_told(rows: list[_Rows]) -> list[_Rows]:
    """Those of dots, where there are enough."""
    dots = [row for row in rows if not row.lines]
    return dots if _count(dots) >= _FEWEST_MARKS else rows


def _count(rows: list[_Rows]) -> int:
    return sum(len(row.squared) for row in rows)


def _rows(take: Take, stretch, radius_vector, used) -> _Rows:
    """Of the marks that were used."""
    o = take.observations
    count = len(o)
    matrix, keep = stretch[:count], used[:count] & ~o.saturated & ~o.overlapping
    brightness = o.flux if o.flux.shape[1] == 3 else np.repeat(o.flux, 3, 1)
    if o.bright:
        brightness = brightness / _spread(matrix, o)[:, None]
    keep &= np.all(brightness > 0, -1)
    squared = np.sum(radius_vector[:count] ** 2, -1)
    lines = bool(np.all(o.family != POINT))
    return _Rows(squared[keep], np.log(brightness[keep]), lines)


def _spread(matrix: np.ndarray, o) -> np.ndarray:
    """Area a dot is magnified by; for a line sample, its width."""
    area = np.abs(np.linalg.det(matrix))
    across = np.where(
        (o.family == LINE_OF_CONSTANT_I)[:, None], matrix[..., 0], matrix[..., 1]
    )
    width = np.abs(np.sum(across * np.nan_to_num(o.normal), -1))
    return np.where(o.family == POINT, area, width)


def _bernstein(s: np.ndarray, degree: int) -> Float[np.ndarray, "points terms"]:
    """As `optics.falloff.bernstein`."""
    return binom.pmf(np.arange(1, degree + 1), degree, s[:, None])


def _fit(number: float | None, rows: list[_Rows]) -> FallOffFit:
    """With as many terms as the marks ask for."""
    limit = max(float(row.squared.max()) for row in rows)
    chosen, cost = _of_terms(number, rows, limit, TERMS[0])
    for terms in TERMS[1:]:
        finer, less = _of_terms(number, rows, limit, terms)
        if cost - less > _LEAST_BIC_GAIN:
            chosen, cost = finer, less
    return chosen


def _of_terms(
    number: float | None, rows: list[_Rows], limit: float, terms: int
) -> tuple[FallOffFit, float]:
    """The best with so many terms, and its Bayesian information criterion."""
    take = np.repeat(np.arange(len(rows)), [len(row.squared) for row in rows])
    s = np.concatenate([row.squared for row in rows]) / limit
    values = np.concatenate([row.brightness for row in rows])
    # Control values are sums of non-negative steps.
    steps = -np.cumsum(_bernstein(s, terms)[:, ::-1], axis=1)[:, ::-1]
    gains = np.eye(len(rows))[take]
    design = np.hstack([steps, gains, -gains])
    control, covariance, cost = [], [], 3 * terms * np.log(len(s))
    for channel in range(3):
        found = _robust(design, values[:, channel], take, terms)
        control.append(np.cumsum(found.solution[:terms]))
        sums = np.tri(terms)
        covariance.append(sums @ found.covariance[:terms, :terms] @ sums.T)
        cost += found.deviance
    fit = FallOffFit(
        number, np.array(control), float(np.sqrt(limit)), np.array(covariance)
    )
    return fit, cost


class _Robust(NamedTuple):
    solution: np.ndarray
    covariance: np.ndarray
    deviance: float
    """Twice the negative logarithm of the likelihood, but for a constant."""


def _robust(
    design: np.ndarray, values: np.ndarray, take: np.ndarray, terms: int
) -> _Robust:
    """Non-negative least squares with Cauchy weights, each take by its own scatter."""
    offset = values.mean()
    weight = np.ones(len(values))
    solution, residual = np.zeros(design.shape[1]), values
    scatter = np.ones(take.max() + 1)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        solution, _ = nnls(design * root[:, None], (values - offset) * root)
        residual = values - offset - design @ solution
        scatter = np.array([_scatter(residual[take == k]) for k in range(len(scatter))])
        weight = 1 / (1 + (residual / (3 * scatter[take])) ** 2) / scatter[take] ** 2
    # A gain may have either sign, for which it has two columns.
    columns = (terms + design.shape[1]) // 2
    known = _covariance(design[:, :columns], weight * residual, weight)
    cauchy = 9 * np.log1p((residual / (3 * scatter[take])) ** 2)
    return _Robust(solution, known, float(np.sum(cauchy + 2 * np.log(scatter[take]))))


def _scatter(residual: np.ndarray) -> float:
    return float(np.median(np.abs(residual)) / 0.6745) + _LEAST_SCATTER


def _covariance(a, pull, weight) -> np.ndarray:
    """Sandwich over the marks; that steps may not be negative is no knowledge."""
    root = np.sqrt(weight)
    # Not from the normal equations: with many terms they are nearly singular.
    moves = np.linalg.pinv(a * root[:, None]) * (pull / root)
    factor = len(a) / max(len(a) - a.shape[1], 1)
    return moves @ moves.T * factor

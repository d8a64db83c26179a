"""Fall-off from how bright the marks are, for every f-number by itself.

A bright dot sends as much light wherever it is, spread over the area of its image: its
flux divided by the magnification of that area is the illumination there. A line's
flux per length is divided by its magnified width. The bright field around dark marks is
proportional to the illumination times the light that fell on the chart.

The logarithm is fitted by a non-increasing Bernstein polynomial
(`lensfit.optics.falloff`) with one gain for each photograph and channel: least squares
with non-negative steps, weighted robustly. An unevenly lit chart cannot be told from
fall-off, unless photographs at another orientation disagree.
"""

from dataclasses import dataclass
from functools import partial

import jax
import numpy as np
from jaxtyping import Float
from scipy.optimize import nnls

from lensfit.batches import in_batches
from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT
from lensfit.fit.adjust import Adjustment
from lensfit.fit.take import Take
from lensfit.optics.falloff import bernstein

TERMS = 5
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
        s = np.minimum(radius_mm / self.valid_radius_mm, 1.0) ** 2
        terms = in_batches(_bernstein, s)
        loss = terms @ self.control.T
        return np.exp(-loss.T) * self._of_terms(terms)

    def deviation_about_mean(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "3 points"]:
        """Standard deviation of the logarithm of the illumination, less its mean over
        these points: what no exposure would undo."""
        s = np.minimum(radius_mm / self.valid_radius_mm, 1.0) ** 2
        terms = in_batches(_bernstein, s)
        return self._of_terms(terms - terms.mean(0))

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
        rows = [row for row in rows if len(row[0])]
        if sum(len(row[0]) for row in rows) >= _FEWEST_MARKS:
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


def _rows(take: Take, stretch, radius_vector, used) -> tuple[np.ndarray, np.ndarray]:
    """Squared radius and log brightness (3 channels) of the marks of one take."""
    o = take.observations
    count = len(o)
    matrix, keep = stretch[:count], used[:count] & ~o.saturated & ~o.overlapping
    brightness = o.flux if o.flux.shape[1] == 3 else np.repeat(o.flux, 3, 1)
    if o.bright:
        brightness = brightness / _spread(matrix, o)[:, None]
    keep &= np.all(brightness > 0, -1)
    squared = np.sum(radius_vector[:count] ** 2, -1)
    return squared[keep], np.log(brightness[keep])


def _spread(matrix: np.ndarray, o) -> np.ndarray:
    """Area a dot is magnified by; for a line sample, its width."""
    area = np.abs(np.linalg.det(matrix))
    across = np.where(
        (o.family == LINE_OF_CONSTANT_I)[:, None], matrix[..., 0], matrix[..., 1]
    )
    width = np.abs(np.sum(across * np.nan_to_num(o.normal), -1))
    return np.where(o.family == POINT, area, width)


_bernstein = jax.jit(jax.vmap(partial(bernstein, degree=TERMS)))


def _fit(number: float | None, rows: list) -> FallOffFit:
    limit = max(float(squared.max()) for squared, _ in rows)
    steps, gains, values = [], [], []
    for k, (squared, brightness) in enumerate(rows):
        terms = in_batches(_bernstein, squared / limit)
        # Control values are sums of non-negative steps.
        steps.append(-np.cumsum(terms[:, ::-1], axis=1)[:, ::-1])
        gains.append(np.eye(len(rows))[np.full(len(squared), k)])
        values.append(brightness)
    design = np.hstack([np.vstack(steps), np.vstack(gains), -np.vstack(gains)])
    control, covariance = [], []
    for channel in range(3):
        solution, known = _robust(design, np.vstack(values)[:, channel])
        control.append(np.cumsum(solution[:TERMS]))
        sums = np.tri(TERMS)
        covariance.append(sums @ known[:TERMS, :TERMS] @ sums.T)
    limit_mm = float(np.sqrt(limit))
    return FallOffFit(number, np.array(control), limit_mm, np.array(covariance))


def _robust(design: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Non-negative least squares with Cauchy weights; solution and its covariance."""
    offset = values.mean()
    weight = np.ones(len(values))
    solution, residual = np.zeros(design.shape[1]), values
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        solution, _ = nnls(design * root[:, None], (values - offset) * root)
        residual = values - offset - design @ solution
        spread = float(np.median(np.abs(residual)) / 0.6745) + 1e-6
        weight = 1 / (1 + (residual / (3 * spread)) ** 2)
    # A gain may have either sign, for which it has two columns.
    columns = (TERMS + design.shape[1]) // 2
    return solution, _covariance(design[:, :columns], weight * residual, weight)


def _covariance(a, pull, weight) -> np.ndarray:
    """Sandwich over the marks; that steps may not be negative is no knowledge."""
    inverse = np.linalg.pinv((a.T * weight) @ a)
    scatter = a * pull[:, None]
    factor = len(a) / max(len(a) - a.shape[1], 1)
    return inverse @ (scatter.T @ scatter) @ inverse * factor

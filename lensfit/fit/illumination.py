"""Fall-off from how bright the marks are, for every f-number by itself.

A bright dot sends as much light wherever it is, spread over the area of its image: its
flux divided by the magnification of that area is the illumination there. A line's
flux per length is divided by its magnified width. The bright field around dark marks is
proportional to the illumination times the light that fell on the chart.

The logarithm is fitted by a non-increasing Bernstein polynomial
(`lensfit.optics.falloff`) with one gain for each photograph and channel: least squares
with non-negative steps, weighted robustly. Clipping by a rim sets in with a kink, which
takes more terms than natural fall-off; their number is chosen by evidence, in which
steps that are zero do not count (M. Meyer and M. Woodroofe, Annals of Statistics 28
(2000) 1083). An unevenly
lit chart cannot be told from fall-off, unless photographs at another orientation
disagree.

Photographs scatter by what they went through: colours of sharp dots in a JPEG, whose
colour planes are halved, by ten times as much as those of blurred ones. Each weighs as
its own scatter says. Where dots were photographed lines have no say: what is read of a
line ends at the same distance everywhere, and a corner's blur goes beyond. What is
expected between the outermost mark and the corner says `beyond_marks`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT
from lensfit.fit.adjust import Adjustment
from lensfit.fit.beyond_marks import Beyond, beyond_marks, reach
from lensfit.fit.non_negative import Expected, NonNegative, robust_non_negative
from lensfit.fit.take import Take
from lensfit.optics.bernstein import continued_bernstein

TERMS = (5, 8, 12, 16)
"""Numbers of terms to choose from."""
_LEAST_BIC_GAIN = 10.0
_LEAST_SCATTER = 1e-4
"""Of a photograph's logarithms; no detector is better."""
_SYSTEMATIC = 0.0006
"""Of the logarithm, what is not seen in residuals: light of a blurred dot that its
aperture misses, fall-off that no polynomial follows. Of thirty random traced lenses the
median error was .1 %."""
_FEWEST_MARKS = 30
_STEP = 1e-3
"""Of differences, half boards."""


@dataclass(frozen=True, eq=False)
class FallOffFit:
    """Fall-off of three channels at one f-number.

    Attributes
    ----------
    f_number : None when nobody said.
    control : b_1 ... b_n of r, g and b.
    valid_radius_mm : Largest radius that the control values are for.
    covariance : Of each channel's control values.
    """

    f_number: float | None
    control: Float[np.ndarray, "3 terms"]
    valid_radius_mm: float
    covariance: Float[np.ndarray, "3 terms terms"]

    def deviation(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "3 points"]:
        """Standard deviation of the relative illumination of r, g and b."""
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
        s = (radius_mm / self.valid_radius_mm) ** 2
        return continued_bernstein(s, self.control.shape[1])

    def _of_terms(self, terms: np.ndarray) -> np.ndarray:
        variance = np.einsum("pi,cij,pj->cp", terms, self.covariance, terms)
        return np.sqrt(np.maximum(variance, 0.0))


def fit_illumination(
    takes: tuple[Take, ...], adjustment: Adjustment, principal_point_mm: np.ndarray
) -> list[FallOffFit]:
    """One fall-off for each f-number among the takes, widest first."""
    stretch = area_stretch(adjustment)
    observed = adjustment.stack.observed_mm
    corner_mm = np.array(takes[0].sensor_size_mm) / 2 + np.abs(principal_point_mm)
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
            found.append(_fit(number, rows, float(corner_mm @ corner_mm)))
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


class _Marks(NamedTuple):
    """Of all takes at one f-number, in one row."""

    squared: Float[np.ndarray, " marks"]
    brightness: Float[np.ndarray, "marks 3"]
    take: Int[np.ndarray, " marks"]


def _best_told(rows: list[_Rows]) -> list[_Rows]:
    """Those of dots, where there are enough."""
    dots = [row for row in rows if not row.lines]
    return dots if _count(dots) >= _FEWEST_MARKS else rows


def _together(rows: list[_Rows]) -> _Marks:
    return _Marks(
        np.concatenate([row.squared for row in rows]),
        np.concatenate([row.brightness for row in rows]),
        np.repeat(np.arange(len(rows)), [len(row.squared) for row in rows]),
    )


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


def _fit(number: float | None, rows: list[_Rows], corner: float) -> FallOffFit:
    """With as many terms as the marks ask for, up to the squared radius `corner`."""
    marks = _together(rows)
    edge = float(marks.squared.max())
    alone = _asked_for(number, marks, edge, [_NOTHING] * 3)
    end = reach(edge, corner)
    if end == edge:
        return alone
    expected = [beyond_marks(control, end / edge) for control in alone.control]
    return _asked_for(number, marks, end, expected)


def _asked_for(
    number: float | None, marks: _Marks, limit: float, expected: list[Beyond]
) -> FallOffFit:
    chosen, cost = _with_terms(number, marks, limit, expected, TERMS[0])
    for terms in TERMS[1:]:
        finer, less = _with_terms(number, marks, limit, expected, terms)
        if cost - less > _LEAST_BIC_GAIN:
            chosen, cost = finer, less
    return chosen


def _with_terms(
    number: float | None,
    marks: _Marks,
    limit: float,
    expected: list[Beyond],
    terms: int,
) -> tuple[FallOffFit, float]:
    """The best with so many terms, and its Bayesian information criterion.

    Parameters
    ----------
    limit : Squared radius up to which it is stated.
    expected : Beyond the marks, of r, g and b.
    """
    gains = np.eye(marks.take.max() + 1)[marks.take]
    # A gain may have either sign, for which it has two columns.
    design = np.hstack([_steps(marks.squared / limit, terms), gains, -gains])
    edge = marks.squared.max() / limit
    found = [
        robust_non_negative(
            design,
            values,
            marks.take,
            terms + gains.shape[1],
            _LEAST_SCATTER,
            _expected(beyond, edge, terms, design.shape[1]),
            _SYSTEMATIC,
        )
        for values, beyond in zip(marks.brightness.T, expected, strict=True)
    ]
    fit = _summed(number, found, terms, float(np.sqrt(limit)))
    deviance = sum(one.deviance for one in found)
    # Steps of zero were held there: they are no freedom of the fit.
    free = sum(int((one.solution[:terms] > 0).sum()) for one in found)
    return fit, deviance + free * np.log(len(marks.squared))


def _summed(
    number: float | None, found: list[NonNegative], terms: int, radius_mm: float
) -> FallOffFit:
    """Control values are sums of steps."""
    sums = np.tri(terms)
    return FallOffFit(
        number,
        np.array([np.cumsum(one.solution[:terms]) for one in found]),
        radius_mm,
        np.array([sums @ one.covariance[:terms, :terms] @ sums.T for one in found]),
    )


def _steps(s: Float[np.ndarray, " places"], terms: int) -> np.ndarray:
    """What the logarithm gains by each step of the control values."""
    return -np.cumsum(continued_bernstein(s, terms)[:, ::-1], axis=1)[:, ::-1]


def _expected(beyond: Beyond, edge: float, terms: int, columns: int) -> Expected:
    """`beyond` as observations of an unknown gain's light; `edge` is s of the outermost
    mark."""
    steps = _steps(beyond.squared * edge, terms)
    free_of_gain = np.zeros((len(steps), columns - terms))
    return Expected(np.hstack([steps, free_of_gain]), -beyond.loss, beyond.deviation)


_NOTHING = Beyond(np.zeros(0), np.zeros(0), np.zeros(0))

"""Fall-off from the brightness of the detections, for each f-number separately.

All bright dots emit the same flux, spread over the area of their image: the flux
divided by the area magnification is proportional to the illumination. The flux of a
line per length is divided by the magnification of its width. The bright field around
dark dots is proportional to the illumination times the light that fell on the chart.

Lines are not used if there are enough dots: a line is measured up to a fixed distance,
and the blur in the corners extends beyond it.

The logarithm of the illumination is fitted by a non-increasing Bernstein polynomial
(`lensfit.optics.falloff`), with one gain for each photograph and channel: least squares
with non-negative steps, weighted robustly. Vignetting by a clipping aperture starts
with a kink, which needs more terms than natural fall-off. The number of terms is
selected by BIC, in which steps of zero do not count (M. Meyer and M. Woodroofe, Annals
of Statistics 28 (2000) 1083). Uneven light on the chart has the same effect as
fall-off, unless photographs at another orientation disagree.

The scatter depends on the file: in a JPEG with subsampled colour planes the colours of
sharp dots scatter ten times as much as those of blurred ones. Each photograph is
weighted by its own scatter.

Detections end up to a pitch before the corner. Beyond them a polynomial is not
determined, and its slope at the outermost detection has the largest standard deviation.
A straight line over its last quarter, in the squared radius, is determined ten times as
well, and lenses fall off at about the same rate from there on. Expected values with
this slope, and a standard deviation of a share of it, are therefore added as
observations beyond the outermost detection, relative to the light there. In the solve
each counts separately, so that a polynomial that cannot follow the detections does not
bend there at little cost. Their errors are fully correlated, being one error of the
slope, and the stated standard deviation of an extrapolated corner includes this.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.detect.observations import LINE_OF_CONSTANT_I, POINT, Observations
from lensfit.fitting.adjust import Adjustment
from lensfit.fitting.chart_view import View
from lensfit.fitting.fall_off.non_negative import (
    Expected,
    NonNegative,
    robust_non_negative,
)
from lensfit.optics.bernstein import continued_bernstein

FEWEST_DETECTIONS = 30
_STEP = 1e-3
"""Of differences, half boards."""
_FARTHEST = 1.7
"""Of the squared radius of the outermost detection; farther out the polynomial's own
slope goes on."""
_PLACES = 6
_SLOPE_SHARE = 0.25
"""Last share of the squared radius, over which the slope is taken."""
_UNSURE, _LEAST_UNSURE = 0.2, 1e-3
"""Of the slope (a rim that begins to clip beyond them, or is through with it), and
of each place by itself."""
_SAMPLES = 32
TERMS = (5, 8, 12, 16)
"""Numbers of terms to choose from."""
_LEAST_BIC_GAIN = 10.0
_LEAST_SCATTER = 1e-4
"""Of a photograph's logarithms; no detector is better."""
SYSTEMATIC = 0.0006
"""Of the logarithm, what is not seen in residuals: light of a blurred dot that its
aperture misses, fall-off that no polynomial follows. Of thirty random traced lenses the
median error was .1 %."""


def area_stretch(adjustment: Adjustment) -> Float[np.ndarray, "views detections 2 2"]:
    """d sensor mm / d board mm at every detection.

    Central differences over a thousandth of the half board, good to a millionth: the
    program that predicts detections serves here too.
    """
    half_mm = np.asarray(adjustment.stack.view.half_board_mm)[:, None]
    board = adjustment.stack.board
    columns = [
        (adjustment.predicted_mm(board + step) - adjustment.predicted_mm(board - step))
        / (2 * _STEP)
        for step in _STEP * np.eye(2)
    ]
    return np.stack(columns, -1) / half_mm[:, :, None]


class Brightness(NamedTuple):
    """Squared radius and log brightness of the detections of one view; `lines` if none
    is a dot."""

    squared_mm2: Float[np.ndarray, " detections"]
    brightness: Float[np.ndarray, "detections 3"]
    lines: bool


class JoinedBrightness(NamedTuple):
    """Of all views at one f-number, in one row."""

    squared_mm2: Float[np.ndarray, " detections"]
    brightness: Float[np.ndarray, "detections 3"]
    take: Int[np.ndarray, " detections"]


def brightness_of(
    view: View,
    stretch: Float[np.ndarray, "most 2 2"],
    radius_vector: Float[np.ndarray, "most 2"],
    used: Bool[np.ndarray, " most"],
) -> Brightness:
    """Of the detections that were used.

    Parameters
    ----------
    stretch : By `area_stretch`, of the detections and then of what fills the stack.
    radius_vector : Of the detections from the principal point, mm.
    """
    o = view.observations
    count = len(o)
    matrix, keep = stretch[:count], used[:count] & ~o.saturated & ~o.overlapping
    brightness = o.flux if o.flux.shape[1] == 3 else np.repeat(o.flux, 3, 1)
    if o.bright:
        brightness = brightness / _spread(matrix, o)[:, None]
    keep &= np.all(brightness > 0, -1)
    squared = np.sum(radius_vector[:count] ** 2, -1)
    lines = bool(np.all(o.family != POINT))
    return Brightness(squared[keep], np.log(brightness[keep]), lines)


def _spread(
    matrix: Float[np.ndarray, "detections 2 2"], o: Observations
) -> Float[np.ndarray, " detections"]:
    """Area a dot is magnified by; for a line sample, its width."""
    area = np.abs(np.linalg.det(matrix))
    across = np.where(
        (o.family == LINE_OF_CONSTANT_I)[:, None], matrix[..., 0], matrix[..., 1]
    )
    width = np.abs(np.sum(across * np.nan_to_num(o.normal), -1))
    return np.where(o.family == POINT, area, width)


def dots_if_enough(rows: list[Brightness]) -> list[Brightness]:
    """The views of dots if they have enough detections, otherwise all."""
    dots = [row for row in rows if not row.lines]
    return dots if count_of(dots) >= FEWEST_DETECTIONS else rows


def joined_brightness(rows: list[Brightness]) -> JoinedBrightness:
    """Views are counted in the order of `rows`."""
    return JoinedBrightness(
        np.concatenate([row.squared_mm2 for row in rows]),
        np.concatenate([row.brightness for row in rows]),
        np.repeat(np.arange(len(rows)), [len(row.squared_mm2) for row in rows]),
    )


def count_of(rows: list[Brightness]) -> int:
    """How many detections there are in all."""
    return sum(len(row.squared_mm2) for row in rows)


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
        terms = self.terms_at(radius_mm)
        loss = terms @ self.control.T
        return np.exp(-loss.T) * self._deviation_of_terms(terms)

    def deviation_about_mean(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "3 points"]:
        """Standard deviation of the logarithm of the illumination, less its mean over
        these points: what no exposure would undo."""
        terms = self.terms_at(radius_mm)
        return self._deviation_of_terms(terms - terms.mean(0))

    def terms_at(
        self, radius_mm: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "points terms"]:
        """What every control value adds to the loss."""
        s = (radius_mm / self.valid_radius_mm) ** 2
        return continued_bernstein(s, self.control.shape[1])

    def _deviation_of_terms(self, terms: np.ndarray) -> np.ndarray:
        variance = np.einsum("pi,cij,pj->cp", terms, self.covariance, terms)
        return np.sqrt(np.maximum(variance, 0.0))


class Beyond(NamedTuple):
    """Places beyond the detections, and how much more is expected to be lost there.

    Attributes
    ----------
    squared : Radius, in squares of that of the outermost detection.
    falls : Minus the logarithm of the illumination, less that at the outermost
        detection.
    deviation : Of that, by which each place counts.
    covariance : Of its errors.
    """

    squared: Float[np.ndarray, " places"]
    falls: Float[np.ndarray, " places"]
    deviation: Float[np.ndarray, " places"]
    covariance: Float[np.ndarray, "places places"]


NOTHING_BEYOND = Beyond(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 0)))


def reach(detected: float, frame: float) -> float:
    """Squared radius up to which fall-off is stated.

    Parameters
    ----------
    detected, frame : Squared radius of the outermost detection and of the farthest
        corner.
    """
    return max(detected, min(frame, _FARTHEST * detected))


def expected_beyond_detections(
    control: Float[np.ndarray, " terms"],
    covariance: Float[np.ndarray, "terms terms"],
    end: float,
) -> Beyond:
    """What is expected up to `end`, in squares of the outermost detection's radius.

    Parameters
    ----------
    control, covariance : Of the fall-off of the detections alone.
    """
    squared = np.linspace(1.0, end, _PLACES + 1)[1:]
    seen = np.linspace(1.0 - _SLOPE_SHARE, 1.0, _SAMPLES)
    slope_of = np.polyfit(seen, continued_bernstein(seen, len(control)), 1)[0]
    slope = max(float(slope_of @ control), 0.0)
    unsure = (_UNSURE * slope) ** 2 + float(slope_of @ covariance @ slope_of)
    out = squared - 1.0
    own = _LEAST_UNSURE**2 * np.eye(_PLACES)
    return Beyond(
        squared,
        slope * out,
        _UNSURE * slope * out + _LEAST_UNSURE,
        unsure * np.outer(out, out) + own,
    )


def fit_illumination(
    views: tuple[View, ...], adjustment: Adjustment, principal_point_mm: np.ndarray
) -> list[FallOffFit]:
    """One fall-off for each f-number among the views, widest first."""
    stretch = area_stretch(adjustment)
    observed = adjustment.stack.observed_mm
    corner_mm = np.array(views[0].sensor_size_mm) / 2 + np.abs(principal_point_mm)
    numbers = sorted({t.f_number for t in views}, key=lambda n: n or 0.0)
    found = []
    for number in numbers:
        rows = [
            brightness_of(
                t, stretch[k], observed[k] - principal_point_mm, adjustment.used[k]
            )
            for k, t in enumerate(views)
            if t.f_number == number
        ]
        rows = dots_if_enough([row for row in rows if len(row.squared_mm2)])
        if count_of(rows) >= FEWEST_DETECTIONS:
            found.append(fit_brightness(number, rows, float(corner_mm @ corner_mm)))
    return found


def fit_brightness(
    number: float | None, seen: list[Brightness], corner_mm2: float
) -> FallOffFit:
    """The fall-off with the number of terms selected by BIC.

    Parameters
    ----------
    corner_mm2 : Squared radius that the frame reaches.
    """
    detections = joined_brightness(seen)
    edge_mm2 = float(detections.squared_mm2.max())
    alone = _selected_fall_off(number, detections, edge_mm2, [NOTHING_BEYOND] * 3)
    end_mm2 = reach(edge_mm2, corner_mm2)
    if end_mm2 == edge_mm2:
        return alone
    expected = [
        expected_beyond_detections(control, covariance, end_mm2 / edge_mm2)
        for control, covariance in zip(alone.control, alone.covariance, strict=True)
    ]
    return _selected_fall_off(number, detections, end_mm2, expected)


def _selected_fall_off(
    number: float | None,
    detections: JoinedBrightness,
    limit_mm2: float,
    expected: list[Beyond],
) -> FallOffFit:
    chosen, cost = with_terms(number, detections, limit_mm2, expected, TERMS[0])
    for terms in TERMS[1:]:
        finer, less = with_terms(number, detections, limit_mm2, expected, terms)
        if cost - less > _LEAST_BIC_GAIN:
            chosen, cost = finer, less
    return chosen


def with_terms(
    number: float | None,
    detections: JoinedBrightness,
    limit_mm2: float,
    expected: list[Beyond],
    terms: int,
) -> tuple[FallOffFit, float]:
    """The best with so many terms, and its Bayesian information criterion.

    Parameters
    ----------
    limit_mm2 : Squared radius up to which it is stated.
    expected : Beyond the detections, of r, g and b.
    """
    design = _steps(detections.squared_mm2 / limit_mm2, terms)
    edge = detections.squared_mm2.max() / limit_mm2
    found = [
        robust_non_negative(
            design,
            values,
            detections.take,
            _LEAST_SCATTER,
            _expected_differences(beyond, edge, terms),
            SYSTEMATIC,
        )
        for values, beyond in zip(detections.brightness.T, expected, strict=True)
    ]
    fit = _fit_of_steps(number, found, terms, float(np.sqrt(limit_mm2)))
    deviance = sum(one.deviance for one in found)
    # Steps of zero were held there: they are no freedom of the fit.
    free = sum(int((one.solution > 0).sum()) for one in found)
    return fit, deviance + free * np.log(len(detections.squared_mm2))


def _fit_of_steps(
    number: float | None, found: list[NonNegative], terms: int, radius_mm: float
) -> FallOffFit:
    """Control values are sums of steps."""
    sums = np.tri(terms)
    return FallOffFit(
        number,
        np.array([np.cumsum(one.solution) for one in found]),
        radius_mm,
        np.array([sums @ one.covariance @ sums.T for one in found]),
    )


def _steps(
    s: Float[np.ndarray, " places"], terms: int
) -> Float[np.ndarray, "places terms"]:
    """What the logarithm gains by each step of the control values."""
    return -np.cumsum(continued_bernstein(s, terms)[:, ::-1], axis=1)[:, ::-1]


def _expected_differences(beyond: Beyond, edge: float, terms: int) -> Expected:
    """`beyond` as differences from the outermost detection, which is at s of `edge`."""
    design = _steps(beyond.squared * edge, terms) - _steps(np.array([edge]), terms)
    return Expected(design, -beyond.falls, beyond.deviation, beyond.covariance)

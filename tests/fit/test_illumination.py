"""Fall-off against a known one: its terms, what each photograph counts, and its stated
deviations against the scatter of many noisy photographs."""

import numpy as np
from scipy.special import comb

from lensfit.fit.illumination import (
    TERMS,
    _best_told,
    _fit,
    _Rows,
    _together,
    _with_terms,
)

CONTROL = np.array([0.1, 0.25, 0.35, 0.5, 0.8])
MARKS, NOISE = 200, 0.01


def test_deviations_cover_the_truth():
    rng = np.random.default_rng(0)
    squared = rng.uniform(0, 1, MARKS)
    squared[0] = 1.0
    radius = np.sqrt(np.linspace(0.02, 1.0, 12))
    covered = []
    for _ in range(60):
        noise = NOISE * rng.normal(size=(MARKS, 3))
        log_light = -loss(squared)[:, None] + 2.0 + noise
        found = _fit(1.4, [_Rows(squared, log_light, lines=False)])
        for channel in range(3):
            value = -loss(radius**2, found.control[channel])
            off = value - value.mean() + loss(radius**2) - loss(radius**2).mean()
            stated = found.deviation_about_mean(radius)[channel]
            covered.append(np.abs(off) <= stated)
    # Steps that may not be negative cost a little.
    assert 0.5 < np.mean(covered) < 0.8


def test_on_the_axis_nothing_is_unknown():
    rng = np.random.default_rng(1)
    squared = rng.uniform(0, 1, MARKS)
    log_light = -loss(squared)[:, None] + NOISE * rng.normal(size=(MARKS, 3))
    found = _fit(1.4, [_Rows(squared, log_light, lines=False)])
    deviation = found.deviation(np.array([0.0, 0.9]))
    assert not deviation[:, 0].any()
    assert np.all((deviation[:, 1] > 0) & (deviation[:, 1] < NOISE))


def test_a_rim_that_clips_takes_more_terms_than_natural_fall_off():
    rng = np.random.default_rng(2)
    squared = np.linspace(0.0, 1.0, 500)
    natural, kink = 0.2 * squared, 2.0 * np.maximum(np.sqrt(squared) - 0.3, 0.0)
    noise = 0.002 * rng.normal(size=(500, 3))
    terms, off = [], []
    for truth in (natural, natural + kink):
        rows = [_Rows(squared, 1.0 - truth[:, None] + noise, lines=False)]
        found = _fit(1.4, rows)
        terms.append(found.control.shape[1])
        fewest, _ = _with_terms(1.4, _together(rows), min(TERMS))
        off.append(
            [np.std(loss(squared, f.control[1]) - truth) for f in (found, fewest)]
        )
        for covariance in found.covariance:
            deviation = np.sqrt(np.diag(covariance))
            correlation = covariance / np.outer(deviation, deviation)
            assert np.linalg.eigvalsh(correlation)[0] > -1e-9
    assert terms[0] == min(TERMS) < terms[1]
    assert max(off[0]) < 0.001
    assert off[1][0] < off[1][1] / 2


def test_a_photograph_counts_as_its_own_scatter_says():
    """One whose colours scatter by a tenth, and by more outwards, hardly matters."""
    rng = np.random.default_rng(3)
    squared = rng.uniform(0, 1, MARKS)
    squared[0] = 1.0
    truth = loss(squared)[:, None]
    good = _Rows(squared, -truth + 0.001 * rng.normal(size=(MARKS, 3)), lines=False)
    bad = _Rows(squared, -0.7 * truth + 0.1 * rng.normal(size=(MARKS, 3)), lines=False)
    at = np.linspace(0.1, 1.0, 10)
    for rows in ([good, bad], [bad, good]):
        found = _fit(1.4, rows)
        for control in found.control:
            np.testing.assert_allclose(loss(at, control), loss(at), atol=0.004)


def test_lines_have_no_say_beside_dots():
    few = _Rows(np.ones(10), np.ones((10, 3)), lines=False)
    dots, lines = (few._replace(squared=np.ones(40), lines=b) for b in (False, True))
    assert _best_told([lines, dots]) == [dots]
    assert _best_told([lines, few]) == [lines, few]


def loss(s: np.ndarray, control: np.ndarray = CONTROL) -> np.ndarray:
    """Minus the logarithm of the illumination, by its definition."""
    degree = len(control)
    powers = np.arange(1, degree + 1)
    choose = comb(degree, powers)
    terms = choose * s[:, None] ** powers * (1 - s[:, None]) ** (degree - powers)
    return terms @ control

"""Fall-off against a known one: its terms, what each photograph counts, and its stated
deviations against the scatter of many noisy photographs."""

import numpy as np
import pytest
from scipy.special import comb

from lensfit.fitting.fall_off.illumination import (
    NOTHING_BEYOND,
    SYSTEMATIC,
    TERMS,
    Brightness,
    dots_if_enough,
    fit_brightness,
    joined_brightness,
    with_terms,
)

CONTROL = np.array([0.1, 0.25, 0.35, 0.5, 0.8])
MARKS, NOISE = 200, 0.01


@pytest.mark.parametrize("photographs", [1, 8])
def test_deviations_cover_the_truth(photographs: int):
    """Noise alone: a deviation that is too small or too large shows in the share."""
    rng = np.random.default_rng(0)
    squared = rng.uniform(0, 1, MARKS)
    squared[0] = 1.0
    radius = np.sqrt(np.linspace(0.02, 1.0, 12))
    covered = []
    for _ in range(60):
        gains = rng.normal(size=(photographs, 3))
        seen = [
            Brightness(part, gain - loss(part)[:, None] + noise, lines=False)
            for part, gain, noise in zip(
                np.array_split(squared, photographs),
                gains,
                np.split(NOISE * rng.normal(size=(MARKS, 3)), photographs),
                strict=True,
            )
        ]
        found = fit_brightness(1.4, seen, 1.0)
        for channel in range(3):
            value = -loss(radius**2, found.control[channel])
            off = value - value.mean() + loss(radius**2) - loss(radius**2).mean()
            stated = found.deviation_about_mean(radius)[channel]
            covered.append(np.abs(off) <= stated)
    assert 0.6 < np.mean(covered) < 0.8


def test_on_the_axis_nothing_is_unknown():
    rng = np.random.default_rng(1)
    squared = rng.uniform(0, 1, MARKS)
    log_light = -loss(squared)[:, None] + NOISE * rng.normal(size=(MARKS, 3))
    found = fit_brightness(1.4, [Brightness(squared, log_light, lines=False)], 1.0)
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
        rows = [Brightness(squared, 1.0 - truth[:, None] + noise, lines=False)]
        found = fit_brightness(1.4, rows, 1.0)
        terms.append(found.control.shape[1])
        fewest, _ = with_terms(
            1.4, joined_brightness(rows), 1.0, [NOTHING_BEYOND] * 3, min(TERMS)
        )
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
    good = Brightness(
        squared, -truth + 0.001 * rng.normal(size=(MARKS, 3)), lines=False
    )
    bad = Brightness(
        squared, -0.7 * truth + 0.1 * rng.normal(size=(MARKS, 3)), lines=False
    )
    at = np.linspace(0.1, 1.0, 10)
    for rows in ([good, bad], [bad, good]):
        found = fit_brightness(1.4, rows, 1.0)
        for control in found.control:
            np.testing.assert_allclose(loss(at, control), loss(at), atol=0.004)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.001, 0.05])
@pytest.mark.parametrize("corner", [1.001, 4 / 3])
def test_a_corner_beyond_the_marks_is_as_far_off_as_is_stated(noise, corner):
    """Natural fall-off, of which the slope beyond the marks is known: what is stated
    is the noise of the level and of the slope, and what a rim might add."""
    rng = np.random.default_rng(4)

    def truth(squared):
        return 0.3 * squared + 0.05 * squared**2

    squared = rng.uniform(0, 1, MARKS)
    squared[0] = 1.0
    off, told = [], []
    for _ in range(60):
        seen = 1.0 - truth(squared)[:, None] + noise * rng.normal(size=(MARKS, 3))
        found = fit_brightness(1.4, [Brightness(squared, seen, lines=False)], corner)
        assert found.valid_radius_mm == pytest.approx(np.sqrt(corner))
        assert np.all(np.diff(found.control, axis=1) >= 0)
        at = np.sqrt([0.0, corner])
        off += (found.control[:, -1] - truth(corner)).tolist()
        told += (found.deviation(at)[:, 1] * np.exp(found.control[:, -1])).tolist()
    rms = np.sqrt(np.mean(np.square([off, told]), -1))
    # Steps that may not be negative know more of an edge than is stated, and what no
    # residual shows is four times as much at the edge as over the marks.
    rim, unseen = 0.2 * 0.4 * (corner - 1.0), 4 * SYSTEMATIC
    assert 0.75 * rms[0] < rms[1] < 1.6 * np.hypot(np.hypot(rms[0], rim), unseen)


@pytest.mark.parametrize("rim", [0.0, 1.0])
def test_a_corner_beyond_marks_that_a_rim_clips_is_foreseen(rim: float):
    """Marks end at three quarters of the squared radius; a rim clips from half on."""
    rng = np.random.default_rng(4)
    corner = 20.0**2

    def truth(squared):
        s = squared / corner
        return 0.3 * s + 0.1 * s**2 + rim * np.maximum(s - 0.5, 0.0)

    squared = rng.uniform(0, 0.75 * corner, MARKS)
    at_corner, told = [], []
    for _ in range(40):
        noise = 0.001 * rng.normal(size=(MARKS, 3))
        seen = 1.0 - truth(squared)[:, None] + noise
        found = fit_brightness(1.4, [Brightness(squared, seen, lines=False)], corner)
        assert found.valid_radius_mm == pytest.approx(20.0)
        assert np.all(np.diff(found.control, axis=1) >= 0)
        at_corner += found.control[:, -1].tolist()
        at = np.array([0.0, 20.0])
        told += (found.deviation(at)[:, 1] * np.exp(found.control[:, -1])).tolist()
    off = np.array(at_corner) - truth(corner)
    assert np.abs(off).max() < 0.04
    assert np.sqrt(np.mean(off**2)) < 1.5 * np.sqrt(np.mean(np.square(told)))


def test_a_frame_that_marks_fill_is_not_left():
    rng = np.random.default_rng(5)
    squared = rng.uniform(0, 1, MARKS)
    rows = [Brightness(squared, -loss(squared)[:, None] * np.ones(3), lines=False)]
    for corner in (0.5, float(squared.max())):
        found = fit_brightness(1.4, rows, corner)
        assert found.valid_radius_mm == pytest.approx(np.sqrt(squared.max()))


def test_a_corner_far_from_all_marks_goes_on_with_the_last_slope():
    rng = np.random.default_rng(6)
    squared = rng.uniform(0, 1, MARKS)
    rows = [Brightness(squared, -0.2 * squared[:, None] * np.ones(3), lines=False)]
    found = fit_brightness(1.4, rows, 9.0)
    assert found.valid_radius_mm < 3.0
    light = np.exp(-found.terms_at(np.array([3.0])) @ found.control.T)
    np.testing.assert_allclose(light, np.exp(-0.2 * 9.0), rtol=0.02)


def test_lines_have_no_say_beside_dots():
    few = Brightness(np.ones(10), np.ones((10, 3)), lines=False)
    dots, lines = (
        few._replace(squared_mm2=np.ones(40), lines=b) for b in (False, True)
    )
    assert dots_if_enough([lines, dots]) == [dots]
    assert dots_if_enough([lines, few]) == [lines, few]


def loss(s: np.ndarray, control: np.ndarray = CONTROL) -> np.ndarray:
    """Minus the logarithm of the illumination, by its definition."""
    degree = len(control)
    powers = np.arange(1, degree + 1)
    choose = comb(degree, powers)
    terms = choose * s[:, None] ** powers * (1 - s[:, None]) ** (degree - powers)
    return terms @ control

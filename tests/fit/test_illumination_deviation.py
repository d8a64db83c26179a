"""Stated deviations of fall-off against the scatter of many noisy photographs."""

import numpy as np

from lensfit.fit.illumination import _fit

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
        found = _fit(1.4, [(squared, log_light)])
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
    found = _fit(1.4, [(squared, log_light)])
    deviation = found.deviation(np.array([0.0, 0.9]))
    assert not deviation[:, 0].any()
    assert np.all((deviation[:, 1] > 0) & (deviation[:, 1] < NOISE))


def loss(s: np.ndarray, control: np.ndarray = CONTROL) -> np.ndarray:
    """Minus the logarithm of the illumination, by its definition."""
    degree = len(control)
    choose = np.array([5, 10, 10, 5, 1.0])
    powers = np.arange(1, degree + 1)
    terms = choose * s[:, None] ** powers * (1 - s[:, None]) ** (degree - powers)
    return terms @ control

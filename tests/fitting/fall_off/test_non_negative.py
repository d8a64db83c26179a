"""Non-negative least squares with levels, against least squares and outliers."""

import numpy as np
import pytest

from lensfit.fitting.fall_off.non_negative import Expected, robust_non_negative

TRUTH = np.array([1.5, 0.7])
NOTHING = Expected(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros((0, 0)))
VALUES, SETS = 240, 6


def shoot(rng, noise: float):
    """A design of two columns, and values in sets with a level each."""
    design = rng.uniform(0, 1, (VALUES, 2))
    member = np.arange(VALUES) % SETS
    levels = 10 * rng.normal(size=SETS)
    return (
        design,
        design @ TRUTH + levels[member] + noise * rng.normal(size=VALUES),
        member,
    )


def test_levels_of_any_size_change_nothing():
    design, values, member = shoot(np.random.default_rng(0), 0.0)
    found = robust_non_negative(design, values, member, 1e-3, NOTHING)
    np.testing.assert_allclose(found.solution, TRUTH, atol=1e-9)


def test_what_would_be_negative_is_zero():
    design, values, member = shoot(np.random.default_rng(1), 0.01)
    values = values - 2 * TRUTH[0] * design[:, 0]
    found = robust_non_negative(design, values, member, 1e-3, NOTHING)
    assert found.solution[0] == 0.0
    assert found.solution[1] > 0.0


@pytest.mark.parametrize("bad", [0, 24])
def test_deviations_are_those_of_many_draws(bad: int):
    """Robust weights pull less than they weigh: the plain sandwich states a sixth too
    little of normal noise. A tenth of the values may be far off."""
    rng = np.random.default_rng(2)
    off, told = [], []
    for _ in range(200):
        design, values, member = shoot(rng, 0.05)
        values[:bad] += rng.choice([-1.0, 1.0], bad)
        found = robust_non_negative(design, values, member, 1e-3, NOTHING)
        off.append(found.solution - TRUTH)
        told.append(np.diag(found.covariance))
    ratio = np.sqrt(np.mean(told, 0) / np.mean(np.square(off), 0))
    assert np.all((ratio > 0.88) & (ratio < 1.15))


def test_an_error_that_all_values_share_does_not_shrink_with_sets():
    stated = []
    for sets in (1, 24):
        design, *_ = shoot(np.random.default_rng(3), 1e-6)
        member = np.arange(VALUES) % sets
        level = np.random.default_rng(4).normal(size=sets)[member]
        found = robust_non_negative(
            design, design @ TRUTH + level, member, 1e-6, NOTHING, systematic=0.01
        )
        stated.append(np.sqrt(np.diag(found.covariance)))
    assert np.all(stated[1] > 0.95 * stated[0])
    # A column spread evenly over 0 to 1 that alone makes .01 / sqrt 2.
    np.testing.assert_allclose(stated[0], 0.01 / np.sqrt(2) * np.sqrt(12), rtol=0.1)


def test_expected_values_err_as_they_are_told_to():
    """One direction that only expected values know has their error, however many."""
    design, values, member = shoot(np.random.default_rng(5), 1e-6)
    design[:, 1] = 0.0
    values = design @ TRUTH
    for count in (1, 9):
        expected = Expected(
            np.tile([0.0, 1.0], (count, 1)),
            np.full(count, TRUTH[1]),
            np.full(count, 0.2),
            np.full((count, count), 0.2**2),
        )
        found = robust_non_negative(design, values, member, 1e-6, expected)
        np.testing.assert_allclose(found.solution, TRUTH, atol=1e-6)
        assert found.covariance[1, 1] == pytest.approx(0.2**2, rel=1e-6)

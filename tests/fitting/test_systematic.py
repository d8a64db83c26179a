"""Covariances of equations that are singular to rounding."""

import numpy as np

from lensfit.fitting.systematic import (
    covariance_nearest,
    covariance_of_equations,
    systematic_covariance,
)


def nearly_spanning(seed: int) -> np.ndarray:
    """Normal equations of 40 terms of which two directions are hardly seen, in units
    twelve orders of magnitude apart."""
    rng = np.random.default_rng(seed)
    design = rng.normal(0, 1, (200, 40))
    design[:, 39] = design[:, :3].sum(1) + 1e-9 * rng.normal(0, 1, 200)
    design[:, 38] = design[:, 4] - design[:, 5] + 1e-9 * rng.normal(0, 1, 200)
    unit = 10.0 ** rng.uniform(-6, 6, 40)
    return (design.T @ design) * np.outer(unit, unit)


def least_eigenvalue(covariance: np.ndarray) -> float:
    deviation = np.sqrt(np.diag(covariance))
    return float(np.linalg.eigvalsh(covariance / np.outer(deviation, deviation))[0])


def test_the_inverse_of_singular_equations_is_a_covariance():
    for seed in range(5):
        assert least_eigenvalue(covariance_of_equations(nearly_spanning(seed))) > -1e-9


def test_of_well_determined_equations_it_is_the_inverse():
    rng = np.random.default_rng(1)
    design = rng.normal(0, 1, (50, 8)) * 10.0 ** rng.uniform(-3, 3, 8)
    matrix = design.T @ design
    found = covariance_of_equations(matrix)
    np.testing.assert_allclose(found @ matrix, np.eye(8), atol=1e-9)


def test_systematic_errors_are_a_covariance_and_explain_what_they_should():
    matrix = nearly_spanning(3)
    precision = np.full(40, 1e-12)
    assert least_eigenvalue(systematic_covariance(matrix, precision, 5.0)) > -1e-9
    rng = np.random.default_rng(2)
    design = rng.normal(0, 1, (50, 6))
    plain = design.T @ design
    found = systematic_covariance(plain, np.full(6, 1e-12), 5.0)
    np.testing.assert_allclose(np.trace(found @ plain), 5.0, rtol=1e-6)


def test_the_nearest_covariance_of_one_is_itself():
    rng = np.random.default_rng(4)
    root = rng.normal(0, 1, (5, 5))
    covariance = root @ root.T
    unit = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(covariance_nearest(covariance, unit), covariance)

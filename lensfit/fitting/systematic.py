"""Covariance of systematic errors, and inverses of nearly singular normal equations.

The terms of a model absorb smooth errors that all observations share, so that the
residuals do not show them. These errors are modelled as a covariance of all terms in
proportion to the inverse of their normal equations, scaled to a given rms effect on the
observations.

Normal equations of nearly collinear terms are singular to rounding, and their plain
inverse has negative variances in some directions. They are therefore scaled to a unit
diagonal, and eigenvalues below the rounding error are raised to it; the inverse is then
a covariance.

Reference: A. Zellner's g-prior (1986), its size known from experience, as type B of the
Guide to the Expression of Uncertainty in Measurement (JCGM 100, 2008); on scaling, A.
van der Sluis, Numerische Mathematik 14 (1969) 14.
"""

import numpy as np
from jaxtyping import Float

_ROUNDING = 1e-13


def systematic_covariance(
    matrix: Float[np.ndarray, "terms terms"],
    precision: Float[np.ndarray, " terms"],
    explained: float,
) -> Float[np.ndarray, "terms terms"]:
    """Covariance of terms that together change chi-squared by `explained` on average.

    Every direction has an equal share of it, whatever the number of detections.

    Parameters
    ----------
    matrix : Normal equations of the terms, without priors.
    precision : Precisions of their priors, which limit the errors of weakly determined
        terms.
    """
    seen = matrix * (len(matrix) / explained)
    inverse = covariance_of_equations(seen + np.diag(precision))
    covariance = inverse @ seen @ inverse
    return covariance_nearest(covariance, np.sqrt(np.diag(inverse)))


def covariance_of_equations(
    matrix: Float[np.ndarray, "parameters parameters"],
) -> Float[np.ndarray, "parameters parameters"]:
    """The inverse of normal equations, positive semidefinite despite rounding."""
    unit = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    size, axes = np.linalg.eigh(matrix / np.outer(unit, unit))
    size = np.maximum(size, _ROUNDING * size[-1]) if len(size) else size
    root = axes / np.sqrt(size) / unit[:, None]
    return root @ root.T


def covariance_nearest(
    matrix: Float[np.ndarray, "parameters parameters"],
    unit: Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, "parameters parameters"]:
    """The positive semidefinite matrix nearest to a symmetric one, in these units."""
    unit = np.where(unit > 0, unit, 1.0)
    size, axes = np.linalg.eigh((matrix + matrix.T) / 2 / np.outer(unit, unit))
    axes = axes * unit[:, None]
    return (axes * np.maximum(size, 0.0)) @ axes.T

"""Errors that no residual shows, as a covariance; and inverses that stay covariances.

Smooth errors that all observations share are taken up by the terms of a model: all of
them are taken to be off together, each as far as it changes what was observed.

Normal equations of terms that nearly span each other are singular to rounding; their
plain inverse has negative variances in some directions. In units of each parameter's
own precision, with what rounding leaves of the smallest eigenvalues raised to it, the
inverse is a covariance.

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
    """Covariance of terms that together change chi-squared by `explained`.

    Parameters
    ----------
    matrix : Normal equations of the terms, without priors.
    precision : Of their priors. What those hold is no error that observations make.
    """
    seen = matrix * (len(matrix) / explained)
    inverse = covariance_of_equations(seen + np.diag(precision))
    covariance = inverse @ seen @ inverse
    return covariance_nearest(covariance, np.sqrt(np.diag(inverse)))


def covariance_of_equations(
    matrix: Float[np.ndarray, "parameters parameters"],
) -> Float[np.ndarray, "parameters parameters"]:
    """The inverse of normal equations."""
    unit = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    size, axes = np.linalg.eigh(matrix / np.outer(unit, unit))
    size = np.maximum(size, _ROUNDING * size[-1]) if len(size) else size
    root = axes / np.sqrt(size) / unit[:, None]
    return root @ root.T


def covariance_nearest(
    matrix: Float[np.ndarray, "parameters parameters"],
    unit: Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, "parameters parameters"]:
    """The covariance nearest to a symmetric matrix, in units of the parameters."""
    unit = np.where(unit > 0, unit, 1.0)
    size, axes = np.linalg.eigh((matrix + matrix.T) / 2 / np.outer(unit, unit))
    axes = axes * unit[:, None]
    return (axes * np.maximum(size, 0.0)) @ axes.T

"""Errors that no residual shows, as a covariance.

Smooth errors that all observations share are taken up by the terms of a model: all of
them are taken to be off together, each as far as it changes what was observed.

Reference: A. Zellner's g-prior (1986), its size known from experience, as type B of the
Guide to the Expression of Uncertainty in Measurement (JCGM 100, 2008).
"""

import numpy as np
from jaxtyping import Float


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
    inverse = np.linalg.inv(seen + np.diag(precision))
    return inverse @ seen @ inverse

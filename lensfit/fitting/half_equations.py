"""Normal equations of two random halves of the detections, and effects in chi-squared.

Model selection and uncertainty both use them: the held-out error of a model is computed
on the half that it was not fitted to, and the sum of both halves is the equations of
all detections.
"""

import numpy as np

from lensfit.fitting.adjust import Adjustment, equations_at, stated_equations
from lensfit.fitting.select import LEAST_EFFECT_PX
from lensfit.fitting.trial import Statistics
from lensfit.fitting.view_stack import noise_mm2, residuals_of


def least_fall(adjustment: Adjustment) -> float:
    """Decrease of chi-squared by the smallest effect for which a term is kept."""
    return explained_by(LEAST_EFFECT_PX, adjustment)


def explained_by(effect_px: float, adjustment: Adjustment) -> float:
    """Chi-squared of a displacement of this rms over the detections, at their mean
    variance: what a term explains that follows it, what an error adds."""
    variance = noise_mm2(adjustment.stack) + adjustment.model_variance_mm2[:, None]
    mean_mm2 = np.mean(variance[adjustment.used])
    px_per_deviation = float(np.sqrt(mean_mm2) / adjustment.stack.mm_per_px.mean())
    return int(adjustment.used.sum()) * (effect_px / px_per_deviation) ** 2


def stated_statistics(adjustment: Adjustment) -> Statistics:
    """Normal equations of the stated values, at the present parameters."""
    here = adjustment.parameters
    matrix, vector, constant = map(np.asarray, stated_equations(adjustment))
    turned = matrix @ here
    squares = float(here @ (turned - 2 * vector) + constant)
    return Statistics(matrix, turned - vector, squares, 0)


def halves_of(adjustment: Adjustment) -> tuple[Statistics, Statistics]:
    """Normal equations of the full model for two random halves of the detections."""
    here = equations_at(adjustment)
    matrix, gradient = np.asarray(here.matrix), np.asarray(here.gradient)
    squares = np.asarray(here.chi_squared)
    chunking = adjustment.stack.chunking
    residuals = residuals_of(adjustment.stack) * adjustment.used
    counts = chunking.in_chunks(residuals) * chunking.real
    one, other = (
        Statistics(
            matrix[half],
            gradient[half],
            float(squares[half]),
            int(counts[:, half::2].sum()),
        )
        for half in (0, 1)
    )
    return one, other

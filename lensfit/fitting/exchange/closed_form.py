"""Coefficients of a closed form, by least squares on what is seen on the photograph.

Errors of an undistorted position are brought to the photograph by the lens' own slope
there, so that all models minimise the same pixels.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from lensfit.fitting.exchange.samples import Samples
from lensfit.preset.exchange.foreign import Points

Vector = Float[np.ndarray, " values"]
_BEYOND = 1e8
"""Pixels, in place of what is not a number."""
_MOST_CALLS = 4000


def fit_undistorting(
    closed: Callable[[Vector, Points], Points], start: Vector, samples: Samples
) -> Vector:
    """Values with which `closed` takes distorted to undistorted mm."""
    inverse = np.linalg.inv(samples.slope) / samples.frame.pitch_mm

    def off_px(values: Vector) -> np.ndarray:
        off = closed(values, samples.distorted_mm) - samples.undistorted_mm
        return np.einsum("nij,nj->ni", inverse, off)

    return _least(off_px, start)


def fit_distorting(
    closed: Callable[[Vector, Points], Points], start: Vector, samples: Samples
) -> Vector:
    """Values with which `closed` takes undistorted to distorted mm."""

    def off_px(values: Vector) -> np.ndarray:
        off = closed(values, samples.undistorted_mm) - samples.distorted_mm
        return off / samples.frame.pitch_mm

    return _least(off_px, start)


def _least(off_px: Callable[[Vector], np.ndarray], start: Vector) -> Vector:
    def bounded(values: Vector) -> np.ndarray:
        off = np.nan_to_num(off_px(values).ravel(), nan=_BEYOND, posinf=_BEYOND)
        return np.clip(off, -_BEYOND, _BEYOND)

    with np.errstate(all="ignore"):
        found = least_squares(
            bounded,
            np.asarray(start, float),
            method="lm",
            x_scale="jac",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=_MOST_CALLS,
        )
    return found.x

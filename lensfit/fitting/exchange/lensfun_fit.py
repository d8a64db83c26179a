"""lensfun's radial models fitted to a lens: distortion, lateral colour, vignetting."""

import numpy as np

from lensfit.errors import ExchangeError
from lensfit.fitting.exchange.closed_form import fit_distorting
from lensfit.fitting.exchange.samples import Samples, residual_of
from lensfit.preset.exchange.foreign import Points
from lensfit.preset.exchange.lensfun import (
    DistortionModel,
    LensfunMap,
    ptlens_terms,
)

_POWERS: dict[DistortionModel, tuple[int, ...]] = {
    "poly5": (2, 4),
    "ptlens": (1, 2, 3),
}
"""Of the radius, in the order of the coefficients."""
_DEAR = {"ptlens": 2.0}


def fit_lensfun(samples: Samples, centre_mm: tuple[float, float]) -> LensfunMap:
    """poly5, or ptlens where that is much nearer.

    Raises
    ------
    ExchangeError : Both turn over inside the frame.
    """
    half_short = min(samples.frame.area_mm) / 2
    centre = np.array(centre_mm)
    found, failure = [], None
    for model, powers in _POWERS.items():

        def closed(values: np.ndarray, points: Points, powers=powers) -> Points:
            about = points - centre
            u = np.linalg.norm(about, axis=-1, keepdims=True) / half_short
            gain = 1 + sum(v * u**k for v, k in zip(values, powers, strict=True))
            return about * gain + centre

        values = fit_distorting(closed, np.zeros(len(powers)), samples)
        try:
            terms = tuple(values.tolist()) if model == "poly5" else ptlens_terms(values)
            one = LensfunMap(model, terms, half_short, centre_mm)
            found.append((residual_of(one, samples).rms_px, one))
        except (ExchangeError, ValueError) as error:
            failure = error
    if not found:
        raise ExchangeError(
            "lensfun's models cannot hold this lens", where=str(samples.frame)
        ) from failure
    # poly5 is read alike by all versions of the library, ptlens is not
    return min(found, key=lambda pair: pair[0] * _DEAR.get(pair[1].model, 1.0))[1]


def fit_tca(
    green_mm: Points,
    channel_mm: Points,
    half_short_mm: float,
    centre_mm: tuple[float, float],
) -> tuple[float, float, float]:
    """v, c, b with which a channel lands where green does, times a polynomial."""
    about, target = green_mm - np.array(centre_mm), channel_mm - np.array(centre_mm)
    r = np.linalg.norm(about, axis=-1, keepdims=True) / half_short_mm
    columns = [(about * r**k).ravel() for k in range(3)]
    found, *_ = np.linalg.lstsq(np.stack(columns, -1), target.ravel())
    return float(found[0]), float(found[1]), float(found[2])


def fit_even_polynomial(
    radius: np.ndarray, illumination: np.ndarray
) -> tuple[tuple[float, float, float], float]:
    """k1, k2, k3 of 1 + k1 r^2 + k2 r^4 + k3 r^6, and the worst error of it."""
    columns = np.stack([radius**2, radius**4, radius**6], -1)
    size = columns.max(0)
    found, *_ = np.linalg.lstsq(columns / size, illumination - 1)
    worst = float(np.abs(1 + columns / size @ found - illumination).max())
    k1, k2, k3 = (found / size).tolist()
    return (k1, k2, k3), worst

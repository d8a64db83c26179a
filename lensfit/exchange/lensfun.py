"""lensfun's lens models: distortion, lateral colour and vignetting as radial functions.

Radii of distortion and lateral colour count in half the *short* side of the calibrated
sensor, those of vignetting in its half diagonal; both follow from its crop factor and
aspect ratio (a crop factor is the ratio of 36 x 24 mm's diagonal to the sensor's).
With u the undistorted and d the distorted radius:

    poly3   d = u (1 - k1 + k1 u^2)
    poly5   d = u (1 + k1 u^2 + k2 u^4)
    ptlens  d = u (1 - a - b - c + c u + b u^2 + a u^3)
    tca     channel = green (v + c green + b green^2)      (poly3; linear has v only)
    pa      brightness = 1 + k1 r^2 + k2 r^4 + k3 r^6

The centre term D of poly3 (1 - k1) and ptlens (1 - a - b - c) is a magnification: the
library divides undistorted radii by D, so that the corrected picture has the real focal
length, which the file states or else is the nominal one times D. Here too u is
counted in the corrected picture, d/u is 1 at the centre. (Version 0.3 does not divide;
poly5, which has no D, is the same everywhere. Versions measure a frame from first to
last pixel centre, which is a thousandth of the shift less.)

Source: lensfun's manual, lensfun.h and modifier.cpp, mod-coord.cpp, mod-subpix.cpp and
mod-color.cpp (version 0.3.95).
"""

import math
from dataclasses import dataclass
from typing import Literal, final

import numpy as np

from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import Points, inverse_points
from lensfit.exchange.samples import Samples, fit_distorting, residual_of

DistortionModel = Literal["none", "poly3", "poly5", "ptlens"]
FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)


def sensor_of_crop(crop_factor: float, aspect_ratio: float) -> tuple[float, float]:
    """Long and short side, mm."""
    short = FULL_FRAME_DIAGONAL_MM / crop_factor / math.hypot(aspect_ratio, 1.0)
    return short * aspect_ratio, short


def centre_magnification(model: DistortionModel, terms: tuple[float, ...]) -> float:
    """D: nominal focal length times this is the real one when the file has none."""
    if model == "poly3":
        return 1 - terms[0]
    return 1 - sum(terms) if model == "ptlens" else 1.0


def unit_terms(model: DistortionModel, terms: tuple[float, ...]) -> np.ndarray:
    """Coefficients of u, u^2, u^3, u^4 in d/u, with u in the corrected picture."""
    gain = centre_magnification(model, terms)
    found = np.zeros(4)
    if model == "poly3":
        found[1] = terms[0] / gain**3
    elif model == "poly5":
        found[[1, 3]] = terms
    elif model == "ptlens":
        a, b, c = terms
        found[:3] = c / gain**2, b / gain**3, a / gain**4
    return found


def ptlens_terms(unit: np.ndarray) -> tuple[float, float, float]:
    """a, b, c of `unit_terms`: the inverse, by Newton from the lens without distortion.

    Raises
    ------
    ValueError : No such lens near the undistorted one.
    """
    c1, b1, a1 = unit[:3]
    gain = 1.0
    for _ in range(100):
        value = gain + a1 * gain**4 + b1 * gain**3 + c1 * gain**2 - 1
        slope = 1 + 4 * a1 * gain**3 + 3 * b1 * gain**2 + 2 * c1 * gain
        if not slope > 0:
            break
        step = value / slope
        gain -= step
        if abs(step) < 1e-15:
            return float(a1 * gain**4), float(b1 * gain**3), float(c1 * gain**2)
    raise ValueError("the distortion is too strong for ptlens")


@final
@dataclass(frozen=True, eq=False)
class LensfunMap:
    """Distortion with its numbers.

    Attributes
    ----------
    terms : As in the file: k1 | k1, k2 | a, b, c.
    half_short_mm : Half the short side of the calibrated sensor.
    centre_mm : Of distortion, from the sensor's.
    """

    model: DistortionModel
    terms: tuple[float, ...]
    half_short_mm: float
    centre_mm: tuple[float, float] = (0.0, 0.0)

    def distorted(self, undistorted_mm: Points) -> Points:
        """The closed form."""
        centre = np.array(self.centre_mm)
        about = np.asarray(undistorted_mm, float) - centre
        u = np.hypot(about[:, 0], about[:, 1]) / self.half_short_mm
        gain = np.polynomial.polynomial.polyval(
            u, [1.0, *unit_terms(self.model, self.terms)]
        )
        return centre + about * gain[:, None]

    def undistorted(self, distorted_mm: Points) -> Points:
        """The inverse; NaN where there is none."""
        return inverse_points(self.distorted, distorted_mm, 2 * self.half_short_mm)


def tca_channel(
    green_mm: Points,
    terms: tuple[float, float, float],
    half_short_mm: float,
    centre_mm: tuple[float, float],
) -> Points:
    """Where red or blue land; `terms` are v, c, b."""
    v, c, b = terms
    about = np.asarray(green_mm, float) - np.array(centre_mm)
    r = np.hypot(about[:, 0], about[:, 1]) / half_short_mm
    return np.array(centre_mm) + about * (v + r * (c + r * b))[:, None]


def vignetting(
    points_mm: Points,
    terms: tuple[float, float, float],
    half_diagonal_mm: float,
    centre_mm: tuple[float, float],
) -> np.ndarray:
    """Brightness at points of the photograph; `terms` are k1, k2, k3."""
    about = (np.asarray(points_mm, float) - np.array(centre_mm)) / half_diagonal_mm
    r2 = np.sum(about**2, -1)
    return 1 + r2 * (terms[0] + r2 * (terms[1] + r2 * terms[2]))


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

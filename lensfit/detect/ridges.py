"""Bright or dark thin lines and their crossings, from second derivatives of the image.

At a scale near half its width a line has one strongly negative curvature, across it; a
crossing of two lines has two. Scale and polarity are those of the strongest ridge,
compared across scales by the normalisation sigma^(3/2) that peaks near a bar's own
width (Lindeberg, "Edge detection and ridge detection with automatic scale selection",
International Journal of Computer Vision 30, 1998, section 5).
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

SCALES_PX = (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0)
CROSSING_PER_RIDGE_SCALE = 1.4
"""A crossing is smoothed a little more, to reach out along its arms."""
FAINTEST_CROSSING = 0.02
"""The same relative to the strong ones of the whole picture, whose corners are dark."""
SECOND_LINE = 0.1
"""Curvature across the weaker of two lines that cross, relative to the other's."""
SURROUNDINGS = 2.0
"""How far around a crossing the picture must go on, in standard deviations of its
smoothing."""
WEAKEST_CROSSING = 0.3
"""Faintest accepted crossing, relative to the strongest around it."""


class RidgeScale(NamedTuple):
    """Where lines stand out most: smoothing, sign (+1 bright), mean strength."""

    sigma_px: float
    sign: int
    strength: float


def curvatures(
    image: Float[np.ndarray, "height width"], sigma_px: float
) -> tuple[Float[np.ndarray, "height width"], Float[np.ndarray, "height width"]]:
    """Smaller and larger principal curvature of the image smoothed by a Gaussian.

    Parameters
    ----------
    image : Samples, channel units.
    sigma_px : Standard deviation of the smoothing, pixels.

    Returns
    -------
    smaller, larger : Eigenvalues of the Hessian, channel units per square pixel.
    """
    xx, xy, yy = hessian(image, sigma_px)
    mean = (xx + yy) / 2
    spread = np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    return mean - spread, mean + spread


def hessian(
    image: Float[np.ndarray, "height width"], sigma_px: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second derivatives xx, xy, yy of the image smoothed by a Gaussian."""
    reach = int(np.ceil(4 * sigma_px))
    u = np.arange(-reach, reach + 1.0)
    g0 = np.exp(-((u / sigma_px) ** 2) / 2)
    g0 /= g0.sum()
    g1 = u / sigma_px**2 * g0
    g2 = (u**2 / sigma_px**4 - 1 / sigma_px**2) * g0
    g2 -= g2.mean()
    image = np.ascontiguousarray(image, np.float32)

    def separable_filter(along_x: np.ndarray, along_y: np.ndarray) -> np.ndarray:
        border = cv2.BORDER_REFLECT_101
        return cv2.sepFilter2D(image, cv2.CV_32F, along_x, along_y, borderType=border)

    return separable_filter(g2, g0), separable_filter(g1, g1), separable_filter(g0, g2)


def strongest_ridge(
    image: Float[np.ndarray, "height width"], polarity: str | None
) -> RidgeScale:
    """Scale and sign at which thin lines stand out most.

    Parameters
    ----------
    image : Samples, channel units.
    polarity : "bright" or "dark" lines; None lets the image say.
    """
    signs = {"bright": (1,), "dark": (-1,), None: (1, -1)}[polarity]
    found = []
    for sigma in SCALES_PX:
        if 8 * sigma > min(image.shape):
            break
        smaller, larger = curvatures(image, sigma)
        for sign in signs:
            ridge = -smaller if sign > 0 else larger
            strength = float(np.percentile(ridge[::2, ::2], 99))
            found.append(RidgeScale(sigma, sign, sigma**1.5 * strength))
    return max(found, key=lambda scale: scale.strength)


def find_crossings(
    image: Float[np.ndarray, "height width"], scale: RidgeScale
) -> tuple[Float[np.ndarray, "crossings 2"], Float[np.ndarray, "height width"]]:
    """Crossings of two lines, and the map of ridge strength that joins them.

    Only those whose surroundings are in the picture: what lies beyond its border is
    filled with a reflection, which makes a crossing of the place where a line ends.

    Returns
    -------
    crossings_px : Positions to a fraction of a pixel, first pixel centre at 0.5.
    ridge : Curvature across the strongest line at each pixel, positive on lines.
    """
    signed = image * np.float32(scale.sign)
    smoothing_px = CROSSING_PER_RIDGE_SCALE * scale.sigma_px
    smaller, larger = curvatures(signed, smoothing_px)
    response = np.maximum(-larger, 0)
    reach = max(image.shape) // 8 | 1
    around = cv2.dilate(response, np.ones((reach, reach), np.uint8))
    around = cv2.blur(around, (reach, reach))
    peaks = subpixel_peaks(response, round(2 * scale.sigma_px))
    columns, rows = np.floor(peaks).astype(int).T
    here = response[rows, columns]
    strong = here > WEAKEST_CROSSING * around[rows, columns]
    if strong.any():
        # Where no crossing is around, the strongest speck of noise is none either.
        strong &= here > FAINTEST_CROSSING * np.percentile(here[strong], 90)
    strong &= here > SECOND_LINE * -smaller[rows, columns]
    border_px = SURROUNDINGS * smoothing_px
    inside = (peaks > border_px) & (peaks < np.array(image.shape[::-1]) - border_px)
    return peaks[strong & inside.all(1)], -smaller


def subpixel_peaks(
    response: Float[np.ndarray, "height width"], radius_px: int
) -> Float[np.ndarray, "peaks 2"]:
    """Local maxima within a square of the given radius, by a parabola in x and in y.

    Returns
    -------
    Positions in pixels, first pixel centre at (0.5, 0.5).
    """
    square = np.ones((2 * radius_px + 1,) * 2, np.uint8)
    is_peak = (response == cv2.dilate(response, square)) & (response > 0)
    is_peak[[0, -1]] = is_peak[:, [0, -1]] = False
    rows, columns = np.nonzero(is_peak)
    centre = response[rows, columns].astype(float)

    def offset(before: np.ndarray, after: np.ndarray) -> np.ndarray:
        bend = np.maximum(2 * centre - before - after, 1e-12 * centre)
        return np.clip((after - before) / (2 * bend), -0.5, 0.5)

    dx = offset(response[rows, columns - 1], response[rows, columns + 1])
    dy = offset(response[rows - 1, columns], response[rows + 1, columns])
    return np.stack([columns + 0.5 + dx, rows + 0.5 + dy], -1)

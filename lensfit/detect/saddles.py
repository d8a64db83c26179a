"""Places where four sectors of alternating brightness meet, as corners of a checker do.

The image has a saddle there: the determinant of its Hessian is strongly negative.
Edges, texture and the outer corners of a board have saddles too; on a small circle
around a true one the brightness goes up and down exactly twice, so that its second
harmonic outweighs all others.
"""

import cv2
import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from lensfit.detect.ridges import hessian, subpixel_peaks

RING_SAMPLES = 24
RING_RADIUS = 2.0
"""Radius of the test circle, in smoothing scales."""
LEAST_SECOND_HARMONIC = 0.75
"""Its least part in the power of the circle, the mean left out."""
FAINTEST = 0.02
"""Least amplitude on the circle, as display-referred brightness of full scale 1."""


def display_brightness(
    image: Float[np.ndarray, "height width"],
) -> Float[np.ndarray, "height width"]:
    """Square root of the light, full scale near 1: noise and shade evened out."""
    top = max(float(np.percentile(image[::4, ::4], 99.5)), 1e-12)
    return np.sqrt(np.clip(image / top, 0, 1.5)).astype(np.float32)


def find_saddles(
    brightness: Float[np.ndarray, "height width"], sigma_px: float
) -> Float[np.ndarray, "saddles 2"]:
    """Saddles of four alternating sectors, to a fraction of a pixel.

    Parameters
    ----------
    brightness : As of `display_brightness`.
    sigma_px : Smoothing, pixels; squares should be at least four times wider.

    Returns
    -------
    Positions in pixels, first pixel centre at (0.5, 0.5).
    """
    xx, xy, yy = hessian(brightness, sigma_px)
    peaks = subpixel_peaks(np.maximum(xy**2 - xx * yy, 0), max(2, round(sigma_px)))
    smooth = cv2.GaussianBlur(brightness, (0, 0), sigma_px / 2)
    harmonics = np.abs(np.fft.rfft(_ring(smooth, peaks, RING_RADIUS * sigma_px)))
    power = harmonics[:, 1:7] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        share = power[:, 1] / power.sum(1)
    amplitude = 2 * harmonics[:, 2] / RING_SAMPLES
    return peaks[(share > LEAST_SECOND_HARMONIC) & (amplitude > FAINTEST)]


def _ring(image: np.ndarray, centres: np.ndarray, radius_px: float) -> np.ndarray:
    """Values on a circle around each centre."""
    angle = 2 * np.pi * np.arange(RING_SAMPLES) / RING_SAMPLES
    x = centres[:, :1] + radius_px * np.cos(angle)
    y = centres[:, 1:] + radius_px * np.sin(angle)
    return map_coordinates(image, [y - 0.5, x - 0.5], order=1, mode="nearest")

"""Gaussian mean of the valid pixels around each pixel (normalised convolution).

    mean = (weights * kept pixels) / (weights * kept),

Gaussian weights convolved with both.

Reference: H. Knutsson and C.-F. Westin, Normalized and Differential Convolution,
Proceedings of CVPR (1993) 515.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32

_LEAST = 1e-6


class NeighbourhoodMean(NamedTuple):
    """Of every pixel.

    Attributes
    ----------
    mean : Of what is kept around it.
    weight : Of that, of all weights; the mean means nothing where it is about 0.
    """

    mean: Float32[np.ndarray, "height width channels"]
    weight: Float32[np.ndarray, "height width"]


def neighbourhood_mean(
    pixels: Float32[np.ndarray, "height width channels"],
    kept: Bool[np.ndarray, "height width"],
    sigma_px: float,
) -> NeighbourhoodMean:
    """Weighted by a Gaussian of this standard deviation.

    Parameters
    ----------
    kept : Pixels to believe; others may be NaN.
    """
    weight = cv2.GaussianBlur(kept.astype(np.float32), (0, 0), sigma_px)
    shown = np.where(kept[..., None], pixels, np.float32(0))
    # OpenCV drops an only channel.
    smooth = cv2.GaussianBlur(shown, (0, 0), sigma_px).reshape(pixels.shape)
    return NeighbourhoodMean(smooth / np.maximum(weight, _LEAST)[..., None], weight)

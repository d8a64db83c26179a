"""What lies near a pixel: the nearest one of a kind, and the mean of those around.

The mean is Gaussian, of the valid pixels around each pixel (normalised convolution),

    mean = (weights * kept pixels) / (weights * kept),

Gaussian weights convolved with both.

Reference: H. Knutsson and C.-F. Westin, Normalized and Differential Convolution,
Proceedings of CVPR (1993) 515.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int

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


def nearest_pixels(
    free: Bool[np.ndarray, "height width"], wanted: Bool[np.ndarray, "height width"]
) -> tuple[Int[np.ndarray, " n"], Float32[np.ndarray, " n"]]:
    """Flat index of the free pixel nearest to each wanted one, and its distance."""
    distance, labels = cv2.distanceTransformWithLabels(
        (~free).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    label = np.asarray(labels, np.int32)
    at = np.flatnonzero(free)
    of_label = np.zeros(len(at) + 1, np.int64)
    of_label[label[free]] = at
    return of_label[label[wanted]], distance[wanted]

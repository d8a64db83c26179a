"""The pixels that an object fills, and its distance over every pixel it touches.

Renderers write one distance for a pixel that two objects share, and for a thin or soft
object it is often the background's. Pixels that the object fills have its distance and
its colour, and their neighbours take both from them. Where none is near, as on a wire
thinner than a pixel, the most covered pixels take the least distance around them.
"""

import cv2
import numpy as np
from jaxtyping import Float32, Int

from lensfit.rendering.nearest import nearest_pixels

LEAST_COVER = 1e-3
NOBODY = -1
"""In place of the index of a pixel."""
_WHOLE = 0.999
_SQUARE = np.ones((3, 3), np.uint8)
_REACH_PX = 3.0
"""A pixel that an object fills, this near, knows the object's distance."""

Plane = Float32[np.ndarray, "height width"]


def own_pixels(
    depth_mm: Plane, coverage: Plane
) -> tuple[Plane, Int[np.ndarray, "height width"]]:
    """Distance of an object where it covers any of a pixel, and who lends it.

    Parameters
    ----------
    depth_mm : Of the plate.
    coverage : The object's share of each pixel.

    Returns
    -------
    The object's distance, the plate's where it is not; and the flat index of the pixel
    nearby that the object fills, `NOBODY` where there is none.
    """
    result, lender = depth_mm.copy(), np.full(depth_mm.shape, NOBODY)
    rows, columns = (np.flatnonzero((coverage > LEAST_COVER).any(i)) for i in (1, 0))
    if not rows.size:
        return result, lender
    box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    index = np.arange(depth_mm.size).reshape(depth_mm.shape)[box].ravel()
    depth, cover = depth_mm[box], coverage[box]
    touched, whole = cover > LEAST_COVER, cover >= _WHOLE
    near = np.zeros_like(touched)
    if whole.any():
        source, away = nearest_pixels(whole, touched)
        near[touched] = away <= _REACH_PX
        source = source[away <= _REACH_PX]
        result[box][near] = depth.ravel()[source]
        lender[box][near] = index[source]
    thin = touched & ~near
    if thin.any():
        crest = thin & (cover >= cv2.dilate(np.where(thin, cover, 0), _SQUARE))
        around = cv2.erode(np.where(touched, depth, np.float32(np.inf)), _SQUARE)
        result[box][thin] = around.ravel()[nearest_pixels(crest, thin)[0]]
    return result, lender

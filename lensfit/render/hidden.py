"""What a near surface hides, continued from its surroundings.

From a hidden pixel one looks into several directions until something visible behind is
met. A surface that is met on opposite sides passes through; the nearest such one does
(a wire behind a wire goes on), and where there is none, that of the nearest pixel met.
All pixels met that are on it give its colour and distance, by the inverse square of how
far they are. So the gap behind a wire is a blend of both of its sides, and the ground
behind a leaf that of its whole rim.
"""

import cv2
import numba as nb
import numpy as np
from jaxtyping import Bool, Float32

from lensfit.render.outlines import STEP_GROWTH, STEP_PX

_DIRECTIONS = 32
_LONGEST = 6.0
"""Of a line through a hidden pixel, over the shortest way out; longer ones do not
show that a surface passes."""

Plane = Float32[np.ndarray, "height width"]
Colour = Float32[np.ndarray, "height width 4"]


def continued(
    rgba: Colour,
    radius_px: Plane,
    source: Bool[np.ndarray, "height width"],
    hidden: Bool[np.ndarray, "height width"],
    reach_px: float,
) -> tuple[Colour, Plane, Bool[np.ndarray, "height width"]]:
    """The picture without what hides, its radii, and where nothing is known of it
    (alpha 0).

    Parameters
    ----------
    source : Pixels that show purely what is behind.
    hidden : Pixels to be filled.
    reach_px : How far from a source a ray may still see.
    """
    filled, filled_px = rgba.copy(), radius_px.copy()
    away = cv2.distanceTransform((~source).astype(np.uint8), cv2.DIST_L2, 5)
    wanted = hidden & (away <= reach_px)
    unknown = hidden & ~wanted
    filled[unknown], filled_px[unknown] = 0, radius_px.min()
    rows, columns = np.nonzero(wanted)
    if len(rows):
        angle = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
        _continue(
            filled,
            filled_px,
            rgba,
            radius_px,
            source,
            rows.astype(np.int32),
            columns.astype(np.int32),
            np.cos(angle).astype(np.float32),
            np.sin(angle).astype(np.float32),
            np.float32(reach_px + 2),
        )
    return filled, filled_px, unknown


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _continue(
    filled, filled_px, rgba, radius_px, source, rows, columns, cosines, sines, reach
):
    height, width = source.shape
    count = len(cosines)
    at_y, at_x = np.empty(count, np.int32), np.empty(count, np.int32)
    away = np.empty(count, np.float32)
    for index in range(len(rows)):
        y, x = rows[index], columns[index]
        nearest, nearest_px = np.float32(1e9), np.float32(0)
        for k in range(count):
            away[k] = np.float32(1e9)
            step = np.float32(1.0)
            while step <= reach:
                v = int(y + step * sines[k] + np.float32(0.5))
                u = int(x + step * cosines[k] + np.float32(0.5))
                if v < 0 or u < 0 or v >= height or u >= width:
                    break
                if source[v, u]:
                    at_y[k], at_x[k], away[k] = v, u, step
                    if step < nearest:
                        nearest, nearest_px = step, radius_px[v, u]
                    break
                step += max(np.float32(1.0), np.float32(0.06) * step)
        if nearest > np.float32(1e8):
            for n in range(4):
                filled[y, x, n] = 0
            continue
        chosen = np.float32(-1e9)
        for k in range(count // 2):
            n = k + count // 2
            if away[k] + away[n] > np.float32(_LONGEST) * nearest + 4:
                continue
            first, second = radius_px[at_y[k], at_x[k]], radius_px[at_y[n], at_x[n]]
            step = np.float32(STEP_PX) + np.float32(STEP_GROWTH) * abs(first)
            if abs(first - second) < step:
                chosen = max(chosen, (first + second) / 2)
        if chosen > np.float32(-1e8):
            nearest_px = chosen
        limit = np.float32(STEP_PX) + np.float32(STEP_GROWTH) * abs(nearest_px)
        colour = np.zeros(4, np.float32)
        total = radius = np.float32(0)
        for k in range(count):
            if away[k] < np.float32(1e8):
                v, u = at_y[k], at_x[k]
                if abs(radius_px[v, u] - nearest_px) < limit:
                    share = np.float32(1) / (away[k] * away[k])
                    for n in range(4):
                        colour[n] += share * rgba[v, u, n]
                    radius += share * radius_px[v, u]
                    total += share
        for n in range(4):
            filled[y, x, n] = colour[n] / total
        filled_px[y, x] = radius / total

"""What a near surface hides, continued from its surroundings.

From a hidden pixel one looks into several directions until something visible behind is
met. A surface that is met on opposite sides passes through; the nearest such one does
(a wire behind a wire goes on), and where there is none, that of the nearest pixel met.
All pixels met that are on it give its colour and distance, by the inverse fourth power
of how far they are: beside an outline that of the next pixel. So the gap behind a wire
is a blend of both of its sides, and the ground behind a leaf that of its whole rim.
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

_STRIDE = 0.06
"""Of a step, over the way so far."""
_NOWHERE = np.float32(1e9)

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
    count = len(cosines)
    at_y, at_x = np.zeros(count, np.int32), np.zeros(count, np.int32)
    away = np.empty(count, np.float32)
    for index in range(len(rows)):
        y, x = rows[index], columns[index]
        for k in range(count):
            away[k], at_y[k], at_x[k] = _met(source, y, x, cosines[k], sines[k], reach)
        nearest = away.argmin()
        if away[nearest] >= _NOWHERE:
            filled[y, x] = 0
            continue
        own_px = radius_px[at_y[nearest], at_x[nearest]]
        through_px = _passing_through(radius_px, at_y, at_x, away, away[nearest])
        if through_px > -_NOWHERE:
            own_px = through_px
        colour = np.zeros(4, np.float32)
        total = radius = np.float32(0)
        for k in range(count):
            its_px = radius_px[at_y[k], at_x[k]]
            if away[k] < _NOWHERE and abs(its_px - own_px) < _step(own_px):
                share = np.float32(1) / (away[k] * away[k])
                share *= share
                for n in range(4):
                    colour[n] += share * rgba[at_y[k], at_x[k], n]
                radius += share * its_px
                total += share
        for n in range(4):
            filled[y, x, n] = colour[n] / total
        filled_px[y, x] = radius / total


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _met(source, y, x, cosine, sine, reach):
    """How far, and at which row and column, a source is met in a direction."""
    height, width = source.shape
    step = np.float32(1)
    while step <= reach:
        v = int(y + step * sine + np.float32(0.5))
        u = int(x + step * cosine + np.float32(0.5))
        if v < 0 or u < 0 or v >= height or u >= width:
            break
        if source[v, u]:
            return step, v, u
        step += max(np.float32(1), np.float32(_STRIDE) * step)
    return _NOWHERE, 0, 0


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _passing_through(radius_px, at_y, at_x, away, nearest):
    """Radius of the nearest surface met on opposite sides; far below all if none."""
    chosen, half = -_NOWHERE, len(away) // 2
    for k in range(half):
        if away[k] + away[k + half] > np.float32(_LONGEST) * nearest + 4:
            continue
        first = radius_px[at_y[k], at_x[k]]
        second = radius_px[at_y[k + half], at_x[k + half]]
        if abs(first - second) < _step(first):
            chosen = max(chosen, (first + second) / 2)
    return chosen


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _step(radius_px):
    return np.float32(STEP_PX) + np.float32(STEP_GROWTH) * abs(radius_px)

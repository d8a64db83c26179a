"""Inpaint the background that a near surface hides, from its surroundings.

From a hidden pixel, the nearest visible background pixel is searched in several
directions. A surface that is found in opposite directions passes behind the near one;
the nearest such surface is continued (a wire behind a wire goes on), and where there is
none, that of the nearest pixel found. The pixels found on it give colour and distance,
weighted by the inverse fourth power of how far they are: beside an outline these are
those of the next pixel. So the gap behind a wire is a blend of both of its sides, and
the ground behind a leaf that of its whole rim.
"""

from collections.abc import Callable

import cv2
import numba as nb
import numpy as np
from jaxtyping import Bool, Float32
from numpy.typing import ArrayLike

from lensfit.rendering.gather import TILE
from lensfit.rendering.outlines import STEP_GROWTH, STEP_PX

_DIRECTIONS = 32
_LONGEST = 6.0
"""Of a line through a hidden pixel, over the shortest way out; longer ones do not
show that a surface passes."""

_STRIDE = 0.06
"""Of a step, over the way so far: the least."""
_SURELY = 0.95
"""Of the distance to the nearest source, which a step may take whole."""
NOWHERE = np.float32(1e9)
_ROUNDS = 2
_SPARE, _SPARE_PX = 0.2, 4.0
"""What a ray stands for on a surface, over its radius of blur and beside."""

Plane = Float32[np.ndarray, "height width"]
Pictures = Float32[np.ndarray, "height width channels"]


def inpainted_background(
    pictures: Pictures,
    radius_px: Plane,
    source: Bool[np.ndarray, "height width"],
    hidden: Bool[np.ndarray, "height width"],
    reach_px: Plane,
) -> tuple[Pictures, Plane, Bool[np.ndarray, "height width"]]:
    """Pictures without what hides, their radii, and where nothing is known of them
    (all 0).

    Parameters
    ----------
    source : Pixels that show purely what is behind.
    hidden : Pixels to be filled.
    reach_px : How far from a source a ray may still see.
    """
    filled, filled_px = pictures.copy(), radius_px.copy()
    away = cv2.distanceTransform((~source).astype(np.uint8), cv2.DIST_L2, 5)
    wanted = hidden & (away <= reach_px)
    unknown = hidden & ~wanted
    rows, columns = np.nonzero(wanted)
    if len(rows):
        angle = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
        _continue(
            filled,
            filled_px,
            unknown,
            pictures,
            radius_px,
            away,
            rows.astype(np.int32),
            columns.astype(np.int32),
            np.cos(angle).astype(np.float32),
            np.sin(angle).astype(np.float32),
            np.float32(reach_px.max() + 2),
        )
    filled[unknown], filled_px[unknown] = 0, radius_px.min()
    return filled, filled_px, unknown


def sight_px(
    radius_px: Plane,
    front: Bool[np.ndarray, "height width"],
    source: Bool[np.ndarray, "height width"],
) -> Plane:
    """How far from its edge a ray may see behind the front, around each pixel.

    Of one ray, the places on two surfaces are no farther apart than their radii of blur
    differ, and each stands for a little around it. What is nowhere in sight of each
    other does not count.
    """
    size = radius_px.shape
    most = joined_in_cells(np.where(front, radius_px, -NOWHERE), np.max, -NOWHERE)
    least = joined_in_cells(np.where(source, radius_px, NOWHERE), np.min, NOWHERE)
    sight = sight_of_cells_px(most, least)
    return sight.repeat(TILE, 0).repeat(TILE, 1)[: size[0], : size[1]]


def sight_of_cells_px(most: Plane, least: Plane) -> Plane:
    """How far a ray may see around each cell, a square of `TILE` pixels.

    Parameters
    ----------
    most : Largest radius of the front in each, `-NOWHERE` where it is not.
    least : Smallest radius of what is behind, `NOWHERE` where that is not.
    """
    sight = farthest_sight_px(most.max(), least.min())
    for _ in range(_ROUNDS):
        around = np.ones((2 * int(np.ceil(sight.max() / TILE)) + 1,) * 2, np.uint8)
        sight = farthest_sight_px(cv2.dilate(most, around), cv2.erode(least, around))
    return sight


def farthest_sight_px(near_px: ArrayLike, far_px: ArrayLike) -> np.ndarray:
    """How far from its edge a ray may see behind a surface, by the radii of both."""
    near, far = np.asarray(near_px), np.asarray(far_px)
    largest = np.maximum(np.abs(near), np.abs(far))
    sight = np.maximum(near - far, 0) + _SPARE * largest + _SPARE_PX
    nothing = (near <= -NOWHERE) | (far >= NOWHERE)
    return np.where(nothing, 0, sight).astype(np.float32)


def joined_in_cells(
    values: Plane, join: Callable, beyond: float | np.floating, side: int = TILE
) -> Plane:
    """Values of each square of pixels, joined.

    Parameters
    ----------
    join : Such as `np.max`, over two axes.
    beyond : What fills squares that reach past the border.
    """
    more = (0, -values.shape[0] % side), (0, -values.shape[1] % side)
    filled = np.pad(values, more, constant_values=beyond)
    cells = filled.reshape(-1, side, filled.shape[1] // side, side)
    return join(cells, (1, 3)).astype(np.float32)


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _continue(
    filled,
    filled_px,
    unknown,
    pictures,
    radius_px,
    distance,
    rows,
    columns,
    cosines,
    sines,
    reach,
):
    count, channels = len(cosines), pictures.shape[2]
    at_y, at_x = np.zeros(count, np.int32), np.zeros(count, np.int32)
    away = np.empty(count, np.float32)
    colour = np.empty(channels, np.float32)
    for index in range(len(rows)):
        y, x = rows[index], columns[index]
        # What is met farther away counts for nothing beside the nearest.
        limit = min(reach, np.float32(_LONGEST) * distance[y, x] + np.float32(4))
        for wide in (limit, reach):
            for k in range(count):
                away[k], at_y[k], at_x[k] = _met(
                    distance, y, x, cosines[k], sines[k], wide
                )
            nearest = away.argmin()
            if away[nearest] < NOWHERE:
                break
        if away[nearest] >= NOWHERE:
            unknown[y, x] = True
            continue
        own_px = radius_px[at_y[nearest], at_x[nearest]]
        through_px = _passing_through(radius_px, at_y, at_x, away, away[nearest])
        if through_px > -NOWHERE:
            own_px = through_px
        colour[:] = 0
        total = radius = np.float32(0)
        for k in range(count):
            its_px = radius_px[at_y[k], at_x[k]]
            if away[k] < NOWHERE and abs(its_px - own_px) < _step(own_px):
                share = np.float32(1) / (away[k] * away[k])
                share *= share
                for n in range(channels):
                    colour[n] += share * pictures[at_y[k], at_x[k], n]
                radius += share * its_px
                total += share
        for n in range(channels):
            filled[y, x, n] = colour[n] / total
        filled_px[y, x] = radius / total


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _met(distance, y, x, cosine, sine, limit):
    """How far, and at which row and column, a source is met in a direction.

    Nothing lies nearer than `distance`, to the nearest source, so the way goes on by as
    much at once.
    """
    height, width = distance.shape
    clear = np.float32(_SURELY) * distance[y, x]
    step = max(np.float32(1), clear - np.float32(0.5))
    while step <= limit:
        v = int(y + step * sine + np.float32(0.5))
        u = int(x + step * cosine + np.float32(0.5))
        if v < 0 or u < 0 or v >= height or u >= width:
            break
        free = distance[v, u]
        if free == 0:
            return np.float32(np.hypot(v - y, u - x)), v, u
        wide = max(np.float32(_STRIDE) * step, np.float32(_SURELY) * free - 1)
        step += max(np.float32(1), wide)
    return NOWHERE, 0, 0


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _passing_through(radius_px, at_y, at_x, away, nearest):
    """Radius of the nearest surface met on opposite sides; far below all if none."""
    chosen, half = -NOWHERE, len(away) // 2
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

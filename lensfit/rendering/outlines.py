"""Pixels along the outline of a near surface, which mix both of its sides.

With F and B the colours of both sides nearby, such a pixel is

    pixel = a F + (1 - a) B,

where the share a follows from the pixel's colour, regularised towards the coverage that
the depth suggests where F and B look alike. The near surface gets the pixel minus
(1 - a) B, so nothing is lost.
"""

from typing import NamedTuple

import cv2
import numba as nb
import numpy as np
from jaxtyping import Bool, Float32

STEP_PX = 0.75
STEP_GROWTH = 0.05
"""Radii that differ by more than this belong to two surfaces."""
_SHAPE_WEIGHT = 0.02
"""Squared difference of colour below which the shape of the depth decides."""
_SHAPE_SIGMA_PX = 0.6
_NEAR = 2
_CROSS = np.ones((3, 3), np.uint8)
_FAR = np.float32(1e9)

Plane = Float32[np.ndarray, "height width"]
Colour = Float32[np.ndarray, "height width 4"]


class Outline(NamedTuple):
    """Pixels on both sides of a step in depth.

    Attributes
    ----------
    pixels : Which.
    front_px : Radius of the near side beside each pixel.
    """

    pixels: Bool[np.ndarray, "height width"]
    front_px: Plane


def outline_between(radius_px: Plane, front: Bool[np.ndarray, "h w"]) -> Outline:
    """Where a near surface ends before a far one."""
    near = cv2.dilate(np.where(front, radius_px, -_FAR), _CROSS)
    far = cv2.dilate(np.where(front, -_FAR, radius_px), _CROSS)
    largest = np.maximum(np.abs(near), np.abs(far))
    step = np.float32(STEP_PX) + np.float32(STEP_GROWTH) * largest
    both = (near > -_FAR) & (far > -_FAR) & (near - far > step)
    return Outline(both, near)


def separated_near_surface(
    rgba: Colour,
    radius_px: Plane,
    front: Bool[np.ndarray, "height width"],
    outline: Outline,
    behind: Colour,
    guide: tuple[Colour, Colour] | None = None,
) -> tuple[Colour, Plane]:
    """The near surface by itself, and its radii.

    Parameters
    ----------
    front : Pixels whose depth is that of the near side.
    behind : What it hides, filled in.
    guide : The same picture with all colours where the depth is, and what that hides,
        by which shares are told; `rgba` and `behind` if None.
    """
    shown = np.where(front[..., None], rgba, np.float32(0))
    shown_px = np.where(outline.pixels, outline.front_px, radius_px)
    rows, columns = np.nonzero(outline.pixels)
    if len(rows):
        _take_apart(
            shown,
            rgba,
            behind,
            *(guide or (rgba, behind)),
            shown_px,
            front,
            outline.pixels,
            rows.astype(np.int32),
            columns.astype(np.int32),
        )
    return shown, shown_px


@nb.njit(fastmath=True, nogil=True, cache=True, error_model="numpy")
def _take_apart(
    shown, rgba, behind, guide, guide_behind, front_px, front, outline, rows, columns
):
    height, width = front.shape
    for index in range(len(rows)):
        y, x = rows[index], columns[index]
        own = front_px[y, x]
        step = STEP_PX + STEP_GROWTH * abs(own)
        colour = np.zeros(4, np.float32)
        total, shape, shapes = 0.0, 0.0, 0.0
        for dy in range(-_NEAR, _NEAR + 1):
            for dx in range(-_NEAR, _NEAR + 1):
                v = min(max(y + dy, 0), height - 1)
                u = min(max(x + dx, 0), width - 1)
                is_near = front[v, u] and abs(front_px[v, u] - own) < step
                if is_near:
                    # The purest pixels count: what least resembles the far side.
                    trust = 1e-4 if outline[v, u] else 1.0
                    if outline[v, u]:
                        away = 0.0
                        for n in range(4):
                            away += (guide[v, u, n] - guide_behind[v, u, n]) ** 2
                        trust = min(1e-4 + 0.02 * away, 0.1)
                    for n in range(4):
                        colour[n] += trust * guide[v, u, n]
                    total += trust
                if max(abs(dy), abs(dx)) <= 1:
                    fall = np.exp(-(dy * dy + dx * dx) / (2 * _SHAPE_SIGMA_PX**2))
                    shapes += fall
                    if front[v, u]:
                        shape += fall
        along = contrast = 0.0
        for n in range(4):
            difference = colour[n] / max(total, 1e-9) - guide_behind[y, x, n]
            along += (guide[y, x, n] - guide_behind[y, x, n]) * difference
            contrast += difference * difference
        share = (along + _SHAPE_WEIGHT * shape / shapes) / (contrast + _SHAPE_WEIGHT)
        share = min(max(share, 0.0), 1.0)
        for n in range(4):
            left = rgba[y, x, n] - (1 - share) * behind[y, x, n]
            shown[y, x, n] = max(left, 0.0)

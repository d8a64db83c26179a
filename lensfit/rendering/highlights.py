"""Small lights far brighter than white: each blurred by its own kernel, exactly.

They are detected on the plate before the warp, where all colours and the depth are
aligned. Each colour is then warped by its own map, and none affects another.

A light of hundreds times white, out of focus, is a disc with a visibly sharp rim. It
needs precision that the rest of the picture does not: a radius true to a hundredth of a
pixel and the kernel of its exact position. So small bright spots are removed from the
plate, each gets the one depth that most of its light has, and their light is spread
pixel by pixel.

A light that fills several pixels has been through the pixel filter of the renderer of
the plate, and its kernel is not filtered by a pixel again: it is sampled three times
finer instead. A light in a single pixel is a point, and its image is the lens' kernel.
"""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit.rendering.neighbours import nearest_pixels, neighbourhood_mean

_WHITE = 1.0
_ABOVE = 2.0
_DIM = 0.05
_FAR_ABOVE = 30.0
"""Over its surroundings: a star on black is a highlight however dim it is."""
_SIZE_PX = 9
_LONGEST_PX = 3 * _SIZE_PX
"""A longer one is a line or an area, whose ends blur and are hidden by themselves."""
_SMOOTH_PX = 3.0
_DEPTH_HOPS = 3
_ROOM_PX = 12
_SEEN_THROUGH = 0.5
"""Surroundings that cover less than this share of what a light does are none."""
_LANDING_PX = 3
"""How far the warp's filter carries a light beyond its own pixels."""
_MOST_BOXES = 2000


class Highlights(NamedTuple):
    """Lights taken off a plate.

    Attributes
    ----------
    light : What was taken, r g b; zero elsewhere.
    radius_px : Radius of blur of each light, and of the nearest one beside it.
    mask : Above 0 where lights lie, by green's map when they have landed: what says
        where a light is, for all of its colours.
    """

    light: Float32[np.ndarray, "height width 3"]
    radius_px: Float32[np.ndarray, "height width"]
    mask: Float32[np.ndarray, "height width"]


class Spot(NamedTuple):
    """One colour of a light: its pixels as a patch, and where that lies.

    Attributes
    ----------
    light : In one colour.
    colour : 0, 1, 2 for red, green, blue.
    row, column : Of the patch's first pixel.
    x, y : Middle of the light that it belongs to, so that all colours of a light get
        kernels of one place.
    radius_px : Of its blur.
    is_point : Whether it is one pixel by itself.
    """

    light: Float32[np.ndarray, "height width"]
    colour: int
    row: int
    column: int
    x: float
    y: float
    radius_px: float
    is_point: bool


def take_highlights(
    rgba: Float32[np.ndarray, "height width 4"],
    radius_px: Float32[np.ndarray, "height width"],
) -> Highlights | None:
    """Take small lights off a plate, in place; None where there are none.

    Parameters
    ----------
    rgba : Loses its lights, not its alpha; the colour of what surrounds them closes
        over the gap.
    radius_px : Signed radius of blur of each pixel; under a light it becomes that of
        the surroundings, or the light's own if that lies farther or stands alone.
    """
    red, green, blue = (rgba[..., c] for c in range(3))
    brightest = np.maximum(np.maximum(red, green), blue)
    if not (brightest > _DIM).any():
        return None
    bright = _lights(brightest, rgba[..., 3])
    if not bright.any():
        return None
    ring = np.ones((3, 3), np.uint8)
    mask = cv2.dilate(bright.astype(np.uint8), ring)
    light, own_px = np.zeros((*mask.shape, 3), np.float32), radius_px.copy()
    at = mask > 0
    hole = cv2.dilate(mask, ring)
    for box, own in _boxes(hole):
        here = at[box] & own
        ground, ground_px = _filled_surroundings(rgba[box], radius_px[box], hole[box])
        own_rgba = rgba[box][here]
        base = np.minimum(ground[here][:, :3], own_rgba[:, :3])
        light[box][here] = own_rgba[:, :3] - base
        lit = light[box].sum(-1)
        own_px[box][here] = _one_depth_each(lit, radius_px[box], here)[here]
        rgba[box][here, :3] = base  # what covers goes on covering
        behind = ground[here][:, 3] > _SEEN_THROUGH * own_rgba[:, 3]
        farther = np.minimum(ground_px[here], own_px[box][here])
        radius_px[box][here] = np.where(behind, farther, own_px[box][here])
    return Highlights(light, _carried_radius_px(own_px, mask), mask.astype(np.float32))


def _lights(
    brightest: Float32[np.ndarray, "height width"],
    alpha: Float32[np.ndarray, "height width"],
) -> np.ndarray:
    """Pixels of small lights."""
    square = np.ones((_SIZE_PX, _SIZE_PX), np.uint8)
    broad = cv2.morphologyEx(brightest, cv2.MORPH_OPEN, square)
    bright = (brightest > _WHITE) & (brightest > _ABOVE * broad + _WHITE / 2)
    stars = (brightest > _DIM) & (brightest > _FAR_ABOVE * broad)
    # A thin thing before nothing is no star: it covers, and is no brighter than white.
    around = cv2.morphologyEx(alpha, cv2.MORPH_OPEN, square)
    bright |= stars & ((around > _SEEN_THROUGH) | (brightest > _WHITE * alpha))
    if not bright.any():
        return bright
    _, label, boxes, _ = cv2.connectedComponentsWithStats(bright.astype(np.uint8))
    is_long = boxes[:, 2:4].max(1) > _LONGEST_PX
    is_long[0] = False
    return bright & ~is_long[label]


def _carried_radius_px(own_px: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The radius of lights as far beside them as the warp may carry them."""
    wide = np.ones((2 * _LANDING_PX + 1,) * 2, np.uint8)
    beside = (cv2.dilate(mask, wide) > 0) & (mask == 0)
    if beside.any():
        source, _ = nearest_pixels(mask > 0, beside)
        own_px[beside] = own_px.ravel()[source]
    return own_px


def _boxes(
    hole: np.ndarray,
) -> Iterator[tuple[tuple[slice, slice], np.ndarray]]:
    """A box with some room around each hole, and which of its pixels are that hole's;
    the whole plate if they are very many."""
    count, label, found, _ = cv2.connectedComponentsWithStats(hole)
    if count > _MOST_BOXES:
        yield (slice(0, hole.shape[0]), slice(0, hole.shape[1])), label > 0
        return
    for i in range(1, count):
        x, y, width, height = (int(v) for v in found[i, :4])
        box = (
            slice(max(y - _ROOM_PX, 0), y + height + _ROOM_PX),
            slice(max(x - _ROOM_PX, 0), x + width + _ROOM_PX),
        )
        yield box, label[box] == i


def _filled_surroundings(
    rgba: np.ndarray, radius_px: np.ndarray, hole: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Colour and radius of the surroundings, continued into holes."""
    kept = hole == 0
    radius = radius_px.copy()
    if kept.any():  # a mean of two distances is that of neither
        source, _ = nearest_pixels(kept, ~kept)
        radius[~kept] = radius_px.ravel()[source]
    return neighbourhood_mean(rgba, kept, _SMOOTH_PX).mean, radius


def _one_depth_each(
    light: np.ndarray, radius_px: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """Every pixel of a light takes the radius of its brightest neighbour, a few
    times over: depth is not anti-aliased, and a rim pixel may hold the background's."""
    result = radius_px.copy()
    height, width = light.shape
    rows, columns = np.nonzero(at)
    best, radius = light.copy(), radius_px.copy()
    for _ in range(_DEPTH_HOPS):
        most, its = best[rows, columns], radius[rows, columns]
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                y = np.clip(rows + dy, 0, height - 1)
                x = np.clip(columns + dx, 0, width - 1)
                brighter = best[y, x] > most
                most = np.where(brighter, best[y, x], most)
                its = np.where(brighter, radius[y, x], its)
        best[rows, columns], radius[rows, columns] = most, its
    result[at] = radius[at]
    return result


def spots(found: Highlights, resolution_px: float) -> Iterator[Spot]:
    """The lights of each colour one by one; those that touch but differ in depth are
    two.

    Parameters
    ----------
    found : As they have landed.
    resolution_px : Radii are rounded to multiples of this, so that kernels repeat.
    """
    whose, middles = _middles(found.mask)
    for colour in range(3):
        light = found.light[..., colour]
        lit = (light != 0).astype(np.uint8)
        count, label, boxes, _ = cv2.connectedComponentsWithStats(lit)
        for i in range(1, count):
            x, y, width, height = (int(v) for v in boxes[i, :4])
            box = np.s_[y : y + height, x : x + width]
            mine = label[box] == i
            steps = np.rint(found.radius_px[box] / resolution_px).astype(int)
            for step in np.unique(steps[mine]):
                part = light[box] * (mine & (steps == step))
                if part.max() <= 0:
                    continue
                alone = bool(part.max() > 0.999 * part.sum())
                peak = np.unravel_index(part.argmax(), part.shape)
                middle_x, middle_y = middles[whose[box][peak]]
                blur_px = float(step) * resolution_px
                yield Spot(part, colour, y, x, middle_x, middle_y, blur_px, alone)


def _middles(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The number of the light nearest to every pixel, and x and y of the middle of
    each light."""
    dark = (mask <= 0).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(
        dark, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_CCOMP
    )
    whose = np.asarray(labels, np.int64)
    rows, columns = np.nonzero(mask > 0)
    own = whose[rows, columns]
    count = np.maximum(np.bincount(own, minlength=int(whose.max()) + 1), 1)
    x, y = (
        np.bincount(own, a + 0.5, minlength=len(count)) / count for a in (columns, rows)
    )
    return whose, np.stack([x, y], -1)

"""A flat plate with depth as two layers: what stands in front, and what it hides.

Along the outline of a near surface a pixel shows both sides, while its depth is that of
one of them. Such a pixel is taken apart: with F and B the colours of both sides nearby,

    pixel = a F + (1 - a) B,

where the share a follows from the pixel's colour, leaning on the shape that the depth
draws where F and B look alike; or from a Cryptomatte, which knows it. The front layer
gets what is left of the pixel when (1 - a) B is taken away, so nothing is lost.

Behind every outline, as far as blur can reach, the back layer continues the nearest
surface that lies behind (colour and depth of its nearest pixel).

Everything here compares radii of blur, not distances: two depths that blur alike are
one surface.
"""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int

from lensfit.render.layer_stack import Mattes
from lensfit.render.nearest import nearest_pixels

STEP_PX = 0.75
_STEP_GROWTH = 0.05
"""Radii that differ by more than this belong to two surfaces."""
_SHAPE_WEIGHT = 0.02
"""Squared difference of colour below which the shape of the depth decides."""
_SHAPE_SIGMA_PX = 0.6
_NEAR = 2
_BESIDE = 0.02
_LEAST_SHARE = 0.02

Plane = Float32[np.ndarray, "height width"]
Colour = Float32[np.ndarray, "height width 4"]


class TwoLayers(NamedTuple):
    """Front and back of a plate; the back is empty (alpha 0) where nothing is hidden.

    Attributes
    ----------
    front, back : Premultiplied.
    front_px, back_px : Radius of the blur of each pixel, signed.
    has_back : Where there is a back.
    """

    front: Colour
    front_px: Plane
    back: Colour
    back_px: Plane
    has_back: Bool[np.ndarray, "height width"]


def two_layers(
    rgba: Colour,
    radius_px: Plane,
    mattes: Mattes | None = None,
    guide: Colour | None = None,
) -> TwoLayers:
    """Front and back of a plate whose depth is given as radius of blur.

    Parameters
    ----------
    rgba : Premultiplied; becomes the front.
    radius_px : Signed, positive in front of the focus distance.
    mattes : Who shares each pixel, over the same window.
    guide : The same picture with all colours where the depth is, by which shares are
        told; `rgba` itself if None.
    """
    beside = outline(radius_px)
    front_px = radius_px.copy()
    alpha = np.ones_like(radius_px)
    known = None
    if mattes is not None and len(mattes.ids) > 1:
        known = _shared_by_objects(rgba, radius_px, mattes)
        beside[known.rows, known.columns] = True
        front_px[known.rows, known.columns] = known.front_px
    if not beside.any():
        none = np.zeros(radius_px.shape, bool)
        return TwoLayers(rgba, radius_px, np.zeros_like(rgba), radius_px, none)
    by_depth = beside.copy()
    if known is not None:
        by_depth[known.rows, known.columns] = False
    front_px[by_depth] = cv2.dilate(radius_px, _CROSS)[by_depth]
    hidden = _hidden(front_px, beside)
    back, back_px, has_back = (
        hidden.colours(rgba),
        front_px.copy(),
        np.zeros_like(beside),
    )
    back_px.ravel()[hidden.at] = front_px.ravel()[hidden.source]
    has_back.ravel()[hidden.at] = True
    y, x = np.nonzero(by_depth)
    guide, behind = (rgba, back) if guide is None else (guide, hidden.colours(guide))
    alpha[y, x] = _shares(guide, radius_px, front_px, behind[y, x], by_depth, y, x)
    if known is not None:
        y, x = known.rows, known.columns
        alpha[y, x] = known.share
        mean = (back[y, x] + known.behind) / 2
        back[y, x] = np.where(has_back[y, x][:, None], mean, known.behind)
        back_px[y, x] = np.where(has_back[y, x], back_px[y, x], known.back_px)
        has_back[y, x] = True
    split = beside & has_back
    left = rgba[split] - (1 - alpha[split])[:, None] * back[split]
    rgba[split] = np.maximum(left, 0)
    return TwoLayers(rgba, front_px, back, back_px, has_back)


_CROSS = np.ones((3, 3), np.uint8)


def _threshold(radius_px: np.ndarray) -> np.ndarray:
    return np.float32(STEP_PX) + np.float32(_STEP_GROWTH) * np.abs(radius_px)


def outline(radius_px: Plane) -> Bool[np.ndarray, "height width"]:
    """Pixels beside a step in depth, on both of its sides."""
    nearest, farthest = cv2.dilate(radius_px, _CROSS), cv2.erode(radius_px, _CROSS)
    largest = np.maximum(np.abs(nearest), np.abs(farthest))
    return nearest - farthest > _threshold(largest)


class _Hidden(NamedTuple):
    """What lies behind outlines, as far as blur can reach.

    Attributes
    ----------
    at : Flat index of the pixels that hide something.
    source : The nearest pixel of the nearest surface behind each.
    """

    at: Int[np.ndarray, " n"]
    source: Int[np.ndarray, " n"]

    def colours(self, rgba: Colour) -> Colour:
        """Continued from there; zero where nothing is hidden."""
        back = np.zeros(rgba.shape, np.float32)
        back.reshape(-1, 4)[self.at] = rgba.reshape(-1, 4)[self.source]
        return back


def _hidden(front_px: Plane, outline: np.ndarray) -> _Hidden:
    """Nearest surface behind each pixel that lies near an outline."""
    away = cv2.distanceTransform((~outline).astype(np.uint8), cv2.DIST_L2, 3)
    farthest = float(front_px.min())
    zone = away <= np.abs(front_px) + (abs(farthest) + 2)
    behind_px = front_px - _threshold(front_px)
    zone &= behind_px >= farthest
    found = [(np.zeros(0, np.int64),) * 2]
    flat_px = front_px.ravel()
    cuts = _cuts(farthest, float(behind_px[zone].max())) if zone.any() else np.zeros(0)
    cut_of = np.searchsorted(cuts, behind_px, side="right") - 1
    for i, cut in enumerate(cuts):
        wanted = zone & (cut_of == i)
        if not wanted.any():
            continue
        free = (front_px <= cut) & ~outline
        if not free.any():
            continue
        source, away = nearest_pixels(free, wanted)
        reach = np.abs(front_px[wanted]) + np.abs(flat_px[source]) + 2
        near = away <= reach
        found.append((np.flatnonzero(wanted)[near], source[near]))
    return _Hidden(*(np.concatenate(part) for part in zip(*found, strict=True)))


def _cuts(low: float, high: float) -> np.ndarray:
    cuts = [low]
    while cuts[-1] < high:
        cuts.append(cuts[-1] + STEP_PX + _STEP_GROWTH * abs(cuts[-1]))
    return np.array(cuts, np.float32)


def _shares(
    rgba: Colour,
    radius_px: Plane,
    front_px: Plane,
    behind: Float32[np.ndarray, "n 4"],
    outline: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
) -> Float32[np.ndarray, " n"]:
    """How much of each outline pixel the near surface covers."""
    own_px, own = front_px[rows, columns], rgba[rows, columns]
    step = _threshold(own_px)
    colour, weight = np.zeros_like(own), np.zeros_like(own_px)
    shape, shapes = np.zeros_like(own_px), 0.0
    colours, radii, mixed = rgba.reshape(-1, 4), radius_px.ravel(), outline.ravel()
    for dy, dx, at in _around(rows, columns, radius_px.shape):
        its_px = radii[at]
        near = np.abs(its_px - own_px) < step
        trust = near * np.where(mixed[at], np.float32(_BESIDE), np.float32(1))
        colour += trust[:, None] * colours.take(at, 0)
        weight += trust
        if max(abs(dy), abs(dx)) <= 1:
            fall = np.exp(-(dy * dy + dx * dx) / (2 * _SHAPE_SIGMA_PX**2))
            shape += np.float32(fall) * (its_px > own_px - step / 2)
            shapes += fall
    colour /= np.maximum(weight, 1e-9)[:, None]
    contrast = colour - behind
    along = ((own - behind) * contrast).sum(-1)
    leaning = np.float32(_SHAPE_WEIGHT) * shape / np.float32(shapes)
    share = (along + leaning) / ((contrast**2).sum(-1) + np.float32(_SHAPE_WEIGHT))
    return np.clip(share, 0, 1)


class _Shared(NamedTuple):
    """Pixels that two objects of different depth share."""

    rows: np.ndarray
    columns: np.ndarray
    share: np.ndarray
    front_px: np.ndarray
    back_px: np.ndarray
    behind: np.ndarray


def _shared_by_objects(rgba: Colour, radius_px: Plane, mattes: Mattes) -> _Shared:
    """What a Cryptomatte knows: each object's depth and colour, from its own pixels
    nearby, the pure ones above all."""
    rows, columns = np.nonzero(mattes.coverage[1] > _LEAST_SHARE)
    first, second = (
        _of_object(rgba, radius_px, mattes, r, rows, columns) for r in (0, 1)
    )
    near_first = first[0] > second[0]
    front_px = np.where(near_first, first[0], second[0])
    back_px = np.where(near_first, second[0], first[0])
    cover = mattes.coverage[:2, rows, columns]
    share = np.where(near_first, cover[0], cover[1]) / np.maximum(cover.sum(0), 1e-3)
    behind = np.where(near_first[:, None], second[1], first[1])
    apart = front_px - back_px > _threshold(front_px)
    keep = apart & (first[2] > 0) & (second[2] > 0)
    found = _Shared(rows, columns, share, front_px, back_px, behind)
    return _Shared(*(part[keep].astype(part.dtype) for part in found))


def _of_object(
    rgba: Colour,
    radius_px: Plane,
    mattes: Mattes,
    rank: int,
    rows: np.ndarray,
    columns: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radius, colour and weight of the object of one rank, around each pixel."""
    wanted = mattes.ids[rank, rows, columns]
    radius = np.zeros(len(rows), np.float32)
    colour, weight = np.zeros((len(rows), 4), np.float32), np.zeros_like(radius)
    colours, radii = rgba.reshape(-1, 4), radius_px.ravel()
    first, covers = mattes.ids[0].ravel(), mattes.coverage[0].ravel()
    for dy, dx, at in _around(rows, columns, radius_px.shape):
        pure = np.square(np.square(np.maximum(covers[at] - 0.5, 0.01)))
        w = pure * (first[at] == wanted) / np.float32(1 + (dy * dy + dx * dx) / 2)
        radius += w * radii[at]
        colour += w[:, None] * colours.take(at, 0)
        weight += w
    total = np.maximum(weight, 1e-20)
    return radius / total, colour / total[:, None], weight


def _around(
    rows: np.ndarray, columns: np.ndarray, shape: tuple[int, ...]
) -> Iterator[tuple[int, int, np.ndarray]]:
    """Offsets to the neighbours of some pixels, and where they lie in a flat plane."""
    reach = range(-_NEAR, _NEAR + 1)
    across = [np.clip(columns + dx, 0, shape[1] - 1) for dx in reach]
    for dy in reach:
        down = np.clip(rows + dy, 0, shape[0] - 1) * shape[1]
        for dx, column in zip(reach, across, strict=True):
            yield dy, dx, down + column

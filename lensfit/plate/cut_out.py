"""Separate named objects of a flat plate into a layer of their own over the background.

A pixel that an object shares holds

    pixel = c W + (1 - c) B

with the object's share c from a Cryptomatte, its colour W and the background's, B. B is
estimated from the pixels without the object around: those on both sides of a wire. W is
estimated from the nearest pixel that the object fills; where there is none, as on a
wire thinner than a pixel, it is the W that explains the pixels around best (least
squares). Of all colours that add up to the pixel, those nearest to both estimates are
taken. The layer is c W with alpha c, so that over B it gives the plate again.

W is bounded: what is brighter than white and the object is a light behind it. Where the
background stands in front of the object, the pixel is left in the plate.

Renderers write one distance for a pixel that two objects share, and for a thin or soft
object it is often the background's. Pixels that the object fills have its distance and
its colour, and their neighbours take both from them. Where none is near, as on a wire
thinner than a pixel, the most covered pixels take the least distance around them.

What is left of the plate is the background and its distance. A shared pixel holds the
background's distance or the object's, whichever the renderer chose. The background's is
that of the nearest free pixel (one that none of the objects touches) of the other
object that the Cryptomatte states there. Behind pixels that the objects fill, the
nearest free pixel is continued.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int, UInt32

from lensfit.io.cryptomatte import Ranks, coverage_of
from lensfit.rendering.layer_stack import LayerStack, Mattes
from lensfit.rendering.neighbours import nearest_pixels, neighbourhood_mean

RANKS = 2
"""Objects of a pixel that the renderer tells apart."""
_NEAR_PX = 3

Plane = Float32[np.ndarray, "height width"]


class Rest(NamedTuple):
    """Distance and objects of what is left of a plate."""

    depth_mm: Plane
    ranks: Ranks


def rest_of_plate(
    depth_mm: Plane,
    own_mm: Plane,
    touched: Bool[np.ndarray, "height width"],
    ranks: Ranks,
    objects: UInt32[np.ndarray, " objects"],
) -> Rest:
    """What is left when objects are taken away.

    Parameters
    ----------
    depth_mm : Of the plate.
    own_mm : Of the objects, where they touch a pixel.
    touched : Where that is.
    ranks : Every rank of the plate's Cryptomatte.
    objects : Ids of the objects.
    """
    left = _without(ranks, touched, objects)
    rest_mm, free = depth_mm.copy(), ~touched
    if not (touched.any() and free.any()):
        return Rest(rest_mm, left)
    source, _ = nearest_pixels(free, touched)
    there, own, beside = depth_mm[touched], own_mm[touched], depth_mm.ravel()[source]
    is_own = np.abs(1 / there - 1 / own) <= np.abs(1 / there - 1 / beside)
    alike = _depth_of_same_object_mm(depth_mm, free, left.ids[0])
    guess = np.where(is_own, beside, there)
    rest_mm[touched] = np.where(np.isnan(alike), guess, alike)
    filled = left.ids[0][touched] == 0
    at = tuple(i[filled] for i in np.nonzero(touched))
    lends = np.unravel_index(source[filled], touched.shape)
    for plane in left:
        plane[:, at[0], at[1]] = plane[:, lends[0], lends[1]]
    return Rest(rest_mm, left)


def _without(
    ranks: Ranks,
    touched: Bool[np.ndarray, "height width"],
    objects: UInt32[np.ndarray, " objects"],
) -> Ranks:
    """The ranks that count; in touched pixels as shares of what is left."""
    left = Ranks(ranks.ids[:RANKS].copy(), ranks.coverage[:RANKS].copy())
    all_ids, coverage = ranks.ids[:, touched], ranks.coverage[:, touched]
    coverage = np.where(np.isin(all_ids, objects), np.float32(0), coverage)
    order = np.argsort(-coverage, axis=0, kind="stable")[:RANKS]
    coverage = np.take_along_axis(coverage, order, 0)
    ids = np.where(coverage > 0, np.take_along_axis(all_ids, order, 0), np.uint32(0))
    left.ids[:, touched] = ids
    left.coverage[:, touched] = coverage / np.maximum(coverage.sum(0), np.float32(1e-6))
    return left


def _depth_of_same_object_mm(
    depth_mm: Plane,
    free: Bool[np.ndarray, "height width"],
    first: UInt32[np.ndarray, "height width"],
) -> Float32[np.ndarray, " touched"]:
    """For each pixel that is not free, the distance of the nearest free one of the same
    object; NaN where none is near."""
    rows, columns = np.nonzero(~free)
    wanted = first[rows, columns]
    found = np.full(len(rows), np.nan, np.float32)
    side = range(-_NEAR_PX, _NEAR_PX + 1)
    for dy, dx in sorted(((y, x) for y in side for x in side), key=_squared_length):
        y = np.clip(rows + dy, 0, free.shape[0] - 1)
        x = np.clip(columns + dx, 0, free.shape[1] - 1)
        lends = np.isnan(found) & free[y, x] & (first[y, x] == wanted) & (wanted != 0)
        found[lends] = depth_mm[y, x][lends]
    return found


def _squared_length(offset: tuple[int, int]) -> int:
    return offset[0] ** 2 + offset[1] ** 2


_BRIGHTER = 2.0
"""Than white and the object, or than white and the surroundings: a light."""
_LIGHT_PX = 9
_LEAST_REST = 0.02
_BESIDE_SIGMA_PX = 1.0
"""Of the weights of pixels without the object: the nearest of each side count most."""
_ALONG_SIGMA_PX = 2.0
"""Over which a thin object is of one colour."""
_LEAST_WEIGHT = 1e-3
"""Of the pixels around; where they have less, the nearest one stands for them."""
_LEAST_SQUARE = 1e-9
_AROUND_PX = 3
"""Reach of the warp's filter, over which the layer's alpha spreads."""

Picture = Float32[np.ndarray, "height width channels"]


LEAST_COVER = 1e-3
NOBODY = -1
"""In place of the index of a pixel."""
_WHOLE = 0.999
_SQUARE = np.ones((3, 3), np.uint8)
_REACH_PX = 3.0
"""A pixel that an object fills, this near, knows the object's distance."""


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


@dataclass(frozen=True, eq=False)
class CutOut:
    """Where objects are cut out of a plate, and what is behind them.

    Attributes
    ----------
    coverage : Their share of each pixel; 0 where they are left in the plate.
    depth_mm : Theirs, and a little beyond.
    lender : Flat index of the pixel that is wholly theirs; `NOBODY` where none is near.
    rest_depth_mm, rest_mattes : The plate without them.
    """

    coverage: Plane
    depth_mm: Plane
    lender: Int[np.ndarray, "height width"]
    rest_depth_mm: Plane
    rest_mattes: Mattes

    @property
    def seen_depth_mm(self) -> Plane:
        """Of the nearest thing in each pixel."""
        return np.where(self.coverage > 0, self.depth_mm, self.rest_depth_mm)

    def cut(self, pixels: Picture) -> tuple[Picture, LayerStack]:
        """The plate without the objects, and their layer.

        Parameters
        ----------
        pixels : Grey, or r g b, or r g b alpha, premultiplied.
        """
        touched = self.coverage > 0
        layer = np.zeros((1, *touched.shape, 4), np.float32)
        rest = pixels.copy()
        free = ~touched & ~_lights(pixels) & np.isfinite(pixels).all(-1)
        if touched.any() and free.any():
            behind = _behind(pixels, free, touched)
            own, c = self._own(pixels, behind), self.coverage[touched][:, None]
            own, behind = _foreground_and_background(
                pixels[touched], c, own, behind[touched]
            )
            rest[touched] = behind
            layer[0, touched, :3] = own[:, :3]
            layer[0, touched, 3:] = own[:, 3:] if own.shape[1] == 4 else c
        return rest, LayerStack(layer, self.depth_mm[None])

    def _own(
        self, pixels: Picture, behind: Picture
    ) -> Float32[np.ndarray, "n channels"]:
        """The objects' colour in the pixels that they touch."""
        touched, thin = self.coverage > 0, self.lender == NOBODY
        own = pixels.reshape(-1, pixels.shape[-1])[self.lender[touched]]
        lone = thin[touched]
        if lone.any():
            tells = touched & thin & np.isfinite(pixels).all(-1)
            colour = _thin_colour(pixels, behind, np.where(tells, self.coverage, 0))
            own[lone] = colour[touched][lone]
        return own


def _behind(
    pixels: Picture,
    free: Bool[np.ndarray, "height width"],
    touched: Bool[np.ndarray, "height width"],
) -> Picture:
    """What pixels without the object suggest behind it."""
    behind, weight = neighbourhood_mean(pixels, free, _BESIDE_SIGMA_PX)
    lone = touched & (weight < _LEAST_WEIGHT)
    if lone.any():
        flat = pixels.reshape(-1, pixels.shape[-1])
        behind[lone] = flat[nearest_pixels(free, lone)[0]]
    return behind


def _thin_colour(pixels: Picture, behind: Picture, coverage: Plane) -> Picture:
    """The W that makes c W + (1 - c) B nearest to the pixels around."""
    c = coverage[..., None]
    shown = np.where(c > 0, pixels - (1 - c) * behind, np.float32(0))
    products = cv2.GaussianBlur(c * shown, (0, 0), _ALONG_SIGMA_PX)
    squares = cv2.GaussianBlur(coverage**2, (0, 0), _ALONG_SIGMA_PX)[..., None]
    colour = products.reshape(pixels.shape) / np.maximum(squares, _LEAST_SQUARE)
    return np.maximum(colour, 0)


def _foreground_and_background(
    pixel: Float32[np.ndarray, "n channels"],
    c: Float32[np.ndarray, "n 1"],
    own: Float32[np.ndarray, "n channels"],
    behind: Float32[np.ndarray, "n channels"],
) -> tuple[np.ndarray, np.ndarray]:
    """c W and B of pixels, from what W and B should be like."""
    r = 1 - c
    off = (pixel - c * own - r * behind) / (c * c + r * r)
    behind = np.maximum(behind + r * off, 0)
    most = _BRIGHTER * c * np.maximum(own, 1)
    share = np.clip(pixel - r * behind, 0, most)
    left = np.maximum(pixel - share - r * behind, 0)
    return share, behind + left / np.maximum(r, _LEAST_REST)


def _lights(pixels: Picture) -> Bool[np.ndarray, "height width"]:
    """Small bright spots, which do not go on behind an object."""
    brightest = np.nan_to_num(pixels[..., :3].max(-1))
    around = cv2.morphologyEx(
        brightest, cv2.MORPH_OPEN, np.ones((_LIGHT_PX, _LIGHT_PX), np.uint8)
    )
    return brightest > _BRIGHTER * np.maximum(around, 1)


def cut_out(depth_mm: Plane, ranks: Ranks, objects: Sequence[int]) -> CutOut:
    """Cut objects out of a plate.

    Parameters
    ----------
    depth_mm : Of the plate; positive, may be infinite.
    ranks : Every rank of its Cryptomatte, without NaN.
    objects : Their ids.
    """
    coverage, most = np.zeros_like(depth_mm), np.zeros_like(depth_mm)
    own_mm, lender = depth_mm.copy(), np.full(depth_mm.shape, NOBODY)
    for each in objects:
        cover = coverage_of(ranks, [each])
        mm, lends = own_pixels(depth_mm, cover)
        leads = (cover > LEAST_COVER) & (cover > most)
        own_mm[leads], lender[leads], most[leads] = (
            mm[leads],
            lends[leads],
            cover[leads],
        )
        coverage += np.where(cover > LEAST_COVER, cover, np.float32(0))
    np.minimum(coverage, 1, out=coverage)
    ids = np.array(objects, np.uint32)
    rest_mm, rest = rest_of_plate(depth_mm, own_mm, coverage > 0, ranks, ids)
    stays = (coverage > 0) & (rest_mm < own_mm)
    coverage[stays], rest_mm[stays] = 0, depth_mm[stays]
    for left, was in zip(rest, ranks, strict=True):
        left[:, stays] = was[:RANKS, stays]
    around = np.ones((2 * _AROUND_PX + 1,) * 2, np.uint8)
    touched = coverage > 0
    ring = (cv2.dilate(touched.astype(np.uint8), around) > 0) & ~touched
    if ring.any():
        own_mm[ring] = own_mm.ravel()[nearest_pixels(touched, ring)[0]]
    return CutOut(coverage, own_mm, lender, rest_mm, Mattes(*rest))

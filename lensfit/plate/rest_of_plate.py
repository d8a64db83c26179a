"""A plate without some of its objects: the background and its distance.

A shared pixel holds the background's distance or the object's, whichever the renderer
chose. The background's is that of the nearest free pixel (one that none of the objects
touches) of the other object that the Cryptomatte states there. Behind pixels that the
objects fill, the nearest free pixel is continued.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, UInt32

from lensfit.io.cryptomatte import Ranks
from lensfit.rendering.nearest import nearest_pixels

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
    alike = _of_alike(depth_mm, free, left.ids[0])
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


def _of_alike(
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
    for dy, dx in sorted(((y, x) for y in side for x in side), key=_squared):
        y = np.clip(rows + dy, 0, free.shape[0] - 1)
        x = np.clip(columns + dx, 0, free.shape[1] - 1)
        lends = np.isnan(found) & free[y, x] & (first[y, x] == wanted) & (wanted != 0)
        found[lends] = depth_mm[y, x][lends]
    return found


def _squared(offset: tuple[int, int]) -> int:
    return offset[0] ** 2 + offset[1] ** 2

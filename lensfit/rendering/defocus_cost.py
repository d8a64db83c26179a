"""Time and memory of depth of field on a plate, predicted from its depth alone.

The work of the renderer is counted in cells of the frame, the squares of its loop over
rays: pixels that are inpainted behind each slab of depth, parts of the frame where that
is done, surfaces that rays meet before one hides the rest. The time of each on one core
was measured on traced and path-traced scenes.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.cores import available_cores
from lensfit.rendering.defocus import tile_with_margin, tiles_of
from lensfit.rendering.gather import TILE, points_along, step_for
from lensfit.rendering.inpainting import NOWHERE, joined_in_cells, sight_of_cells_px
from lensfit.rendering.neighbours import nearest_pixels
from lensfit.rendering.plate_defocus import Defocus, Rays
from lensfit.rendering.surfaces import EVEN_PX

_RAY_S, _TILE_S = 6.5e-9, 1e-4
"""For a ray, a point and a surface that it meets; for a tile of the loop; of one
colour."""
_ALL_COLOURS = 1.1
"""The same for three colours that share their rays, over one."""
_MET_RADII, _MET_PX = 1.35, 8.0
"""How far beside a surface rays meet it, in radii of its spots, and more."""
_FULL = 0.99
"""Share of a cell that hides all behind it."""
_CUBIC = 3.0
_UNEVEN = 1.5
"""For a surface read by a cubic, or whose distance varies, over one that is plain."""
_REGION_S, _SURFACE_S = 8e-9, 1.2e-7
"""For a pixel of a tile with its margin, and a surface; of the part where it is."""
_GUIDED = 2.0
"""The latter with a guide, which is continued as well, over one without."""
_HIDDEN_S = 7.3e-7
"""For a pixel that is continued behind a surface."""
_REGION_BYTES, _GUIDE_BYTES, _SURFACE_BYTES = 60.0, 30.0, 40.0
"""Of a pixel of a tile with its margin, without and for a guide; and of the part where
a surface is."""
_ENOUGH = 2.5e6
"""Pixels that show where slabs lie."""


class DefocusCost(NamedTuple):
    """What depth of field costs.

    Attributes
    ----------
    is_sharp : Nothing would be seen of it.
    surfaces : Most that the frame is cut into.
    channels : With rays of their own.
    tiles : That the frame is made in.
    surfaces_s, rays_s : Seconds on these cores.
    gib : Memory for the tiles in work.
    """

    is_sharp: bool
    surfaces: int = 0
    channels: int = 1
    tiles: int = 0
    surfaces_s: float = 0.0
    rays_s: float = 0.0
    gib: float = 0.0


def defocus_cost(
    radius_px: Float32[np.ndarray, "*layers height width"],
    window: Window,
    output: Window,
    defocus: Defocus,
    cores: int | None = None,
) -> DefocusCost:
    """Of a plate with these signed radii of blur.

    Parameters
    ----------
    window, output : Pixels of the plate's surroundings, and those that are made.
    cores : That share the work; those of this process if None.
    """
    radius_px = radius_px.reshape(-1, *radius_px.shape[-2:])
    least, most = float(radius_px.min()), float(radius_px.max())
    rays = defocus.rays(window, least, most)
    if rays.is_sharp(radius_px):
        return DefocusCost(is_sharp=True)
    cuts = defocus.slabs(least, most).cuts_px([radius_px])
    reach = rays.reach_px(least, most)
    cores = cores or available_cores()
    tiles = list(tiles_of(output, reach, cores))
    slabs = _Slabs.of(radius_px, cuts)
    found = [_cost_of_tile(slabs, tile, reach, window, rays) for tile in tiles]
    at_once = min(cores, len(tiles))
    return DefocusCost(
        is_sharp=False,
        surfaces=len(cuts) + 1,
        channels=len(rays.many.weight),
        tiles=len(tiles),
        surfaces_s=sum(one.surfaces_s for one in found) / cores,
        rays_s=sum(one.rays_s for one in found) / cores,
        gib=at_once * max(one.bytes for one in found) / 2**30,
    )


class _TileCost(NamedTuple):
    """Seconds of one core, and memory, of a tile."""

    surfaces_s: float
    rays_s: float
    bytes: float


@dataclass(frozen=True, eq=False)
class _Slabs:
    """Slabs of depth in the cells of a frame, near to far.

    Attributes
    ----------
    share : Of each cell that is in a slab.
    least, most : Radii of a slab in each cell; beyond all where it is not.
    """

    share: Float32[np.ndarray, "slabs rows columns"]
    least: Float32[np.ndarray, "slabs rows columns"]
    most: Float32[np.ndarray, "slabs rows columns"]

    @classmethod
    def of(
        cls, radius_px: Float32[np.ndarray, "layers height width"], cuts: list[float]
    ) -> "_Slabs":
        side = TILE
        while radius_px[0].size > _ENOUGH and side > 2:
            radius_px, side = radius_px[:, ::2, ::2], side // 2
        edges = [np.inf, *cuts, -np.inf]
        share, least, most = [], [], []
        for nearest, farthest in pairwise(edges):
            here = (radius_px > farthest) & (radius_px <= nearest)
            covered = np.asarray(here.any(0), np.float32)
            share.append(joined_in_cells(covered, np.mean, 0.0, side))
            low = np.where(here, radius_px, NOWHERE).min(0)
            high = np.where(here, radius_px, -NOWHERE).max(0)
            least.append(joined_in_cells(low, np.min, NOWHERE, side))
            most.append(joined_in_cells(high, np.max, -NOWHERE, side))
        return cls(*(np.stack(part) for part in (share, least, most)))

    def cropped(self, region: Window, window: Window) -> "_Slabs":
        """Cells of a part of the window."""
        rows = _cells_of(region.y_min, region.y_max, window.y_min)
        columns = _cells_of(region.x_min, region.x_max, window.x_min)
        parts = self.share, self.least, self.most
        return _Slabs(*(part[:, rows, columns].copy() for part in parts))


def _cells_of(first: int, last: int, origin: int) -> slice:
    return slice((first - origin) // TILE, (last - origin) // TILE + 1)


def _cost_of_tile(
    slabs: _Slabs, tile: Window, reach: int, window: Window, rays: Rays
) -> _TileCost:
    region = tile_with_margin(tile, 2 * reach, window)
    mine = slabs.cropped(region, window)
    pixels = region.width * region.height
    surfaces_s, size = 0.0, _REGION_BYTES * pixels
    of_box_s = _SURFACE_S
    if len(rays.many.weight) > 1:
        size += _GUIDE_BYTES * pixels
        of_box_s *= _GUIDED
    present = [n for n in range(len(mine.share)) if mine.share[n].any()]
    for n in present[:-1]:
        hidden, box = _taken_off(mine, n)
        surfaces_s += _REGION_S * pixels + of_box_s * box + _HIDDEN_S * hidden
        size += _SURFACE_BYTES * box
    rows = _cells_of(tile.y_min, tile.y_max, region.y_min)
    columns = _cells_of(tile.x_min, tile.x_max, region.x_min)
    each_s = _rays_s(mine, present, rays)[rows, columns]
    share = tile.width * tile.height / (each_s.size * TILE**2)
    return _TileCost(surfaces_s, float(each_s.sum()) * share, size)


def _taken_off(slabs: _Slabs, n: int) -> tuple[float, float]:
    """Pixels that a slab hides and a ray may see, which go to what is behind; and those
    of the part of the frame where that is looked for."""
    front, rest = slabs.share[n] > 0, slice(n + 1, None)
    behind = np.asarray((slabs.share[rest] > 0).any(0))
    sight = sight_of_cells_px(slabs.most[n], slabs.least[rest].min(0))
    source, away = nearest_pixels(behind, front)
    # A cell that holds both holds the edge.
    seen = np.maximum(away - 0.5, 0) * TILE <= sight[front]
    at = tuple(index[seen] for index in np.nonzero(front))
    of = np.unravel_index(source[seen], front.shape)
    to = n + 1 + (slabs.share[rest][:, *of] > 0).argmax(0)
    hidden = np.minimum(slabs.share[n][at], sight[at] / TILE)
    slabs.share[to, *at] = np.minimum(slabs.share[to, *at] + hidden, 1)
    slabs.least[to, *at] = np.minimum(slabs.least[to, *at], slabs.least[to, *of])
    slabs.most[to, *at] = np.maximum(slabs.most[to, *at], slabs.most[to, *of])
    room = 2 * float(sight.max())
    tall, wide = (
        min(TILE * (where[-1] - where[0] + 1) + room, TILE * size)
        for where, size in (
            (np.flatnonzero(front.any(1 - axis)), front.shape[axis]) for axis in (0, 1)
        )
    )
    return float(hidden.sum()) * TILE**2, tall * wide


def _rays_s(
    slabs: _Slabs, present: list[int], rays: Rays
) -> Float32[np.ndarray, "rows columns"]:
    """Seconds of the loop over rays for each cell."""
    budget = rays.defocus.budget
    aberrated = float(np.median(rays.few.spot_radius_px(0.0)))
    size = slabs.share.shape[1:]
    is_open = np.ones(size, bool)
    met, low, high = np.zeros(size), np.full(size, np.inf), np.zeros(size)
    for n in present:
        here = slabs.share[n] > 0
        ends = slabs.least[n][here].min(), slabs.most[n][here].max()
        least = 0.0 if ends[0] < 0 < ends[1] else np.abs(ends).min()
        spots = np.hypot([least, np.abs(ends).max()], aberrated)
        reach = (_MET_RADII * spots[1] + _MET_PX) / TILE
        around = np.ones((2 * round(reach) + 1,) * 2, np.uint8)
        reached = is_open & (cv2.dilate(here.astype(np.uint8), around) > 0)
        met += reached * (1.0 if ends[1] - ends[0] < EVEN_PX else _UNEVEN)
        low = np.where(reached, np.minimum(low, spots[0]), low)
        high = np.where(reached, np.maximum(high, spots[1]), high)
        full = (slabs.share[n] > _FULL).astype(np.uint8)
        is_open &= cv2.erode(full, around) == 0
    count = np.where(high <= budget.few_px, rays.few.rays, rays.many.rays)
    steps = [step_for(float(r)) for r in low.ravel()]
    points = np.array([points_along(TILE, step) ** 2 for step in steps]).reshape(size)
    cubic = np.where(low < budget.cubic_px, _CUBIC, 1.0)
    channels = len(rays.many.weight)
    each = _ALL_COLOURS if channels == 1 else channels
    moved = high > budget.unseen_px
    each_s = met * count * cubic * points * _RAY_S + _TILE_S
    return each * moved * each_s

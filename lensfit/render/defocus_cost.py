"""What depth of field costs on a plate: seconds and memory, from its depth alone.

The loop over rays takes a time for each ray, point and surface met; how many of these a
part of the frame has follows from how much its depth spreads within reach of the blur.
Constants are those of one core, measured on traced and path-traced scenes.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.cores import available_cores
from lensfit.render.defocus import grown, tiles_of
from lensfit.render.gather import TILE, step_for
from lensfit.render.plate_defocus import Defocus, Rays

_RAY_S = 5.8e-9
"""For a ray, a point and a surface that it meets; of one colour."""
_ALL_COLOURS = 1.6
"""The same for three colours that share their rays, over one."""
_CUBIC = 3.0
_UNEVEN = 1.5
"""For a surface read by a cubic, or whose distance varies, over one that is plain."""
_EVEN_PX = 1e-3
_SURFACE_S = 1.6e-8
"""For a pixel of a tile with its margin, and a surface."""
_HIDDEN_S = 3e-7
"""For a pixel that is continued behind a surface."""
_SURFACE_BYTES = 36.0


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
    regions = [grown(tile, 2 * reach, window) for tile in tiles]
    work = sum(region.width * region.height for region in regions)
    largest = max(region.width * region.height for region in regions)
    cores = min(cores, len(tiles))
    present = (len(cuts) + 2) / 2
    share = output.width * output.height / radius_px[0].size
    rays_s, hidden = _rays_s(radius_px, cuts, reach, rays)
    return DefocusCost(
        is_sharp=False,
        surfaces=len(cuts) + 1,
        channels=len(rays.many.weight),
        tiles=len(tiles),
        surfaces_s=(work * present * _SURFACE_S + hidden * _HIDDEN_S) / cores,
        rays_s=share * rays_s / cores,
        gib=cores * largest * (len(cuts) + 2) * _SURFACE_BYTES / 2**30,
    )


def _rays_s(
    radius_px: np.ndarray, cuts: list[float], reach: int, rays: Rays
) -> tuple[float, float]:
    """Seconds of the loop over rays, on one core, for all pixels of the plate; and how
    many pixels hide something that is to be continued."""
    budget = rays.defocus.budget
    aberrated = float(np.median(rays.few.spot_radius_px(0.0)))
    size = -(-radius_px.shape[1] // TILE), -(-radius_px.shape[2] // TILE)
    around = np.ones((2 * -(-reach // TILE) + 1,) * 2, np.uint8)
    slab = np.searchsorted(np.sort(cuts), radius_px)
    met, work = np.zeros((2, *size), np.float32)
    low, high = np.full(size, np.inf, np.float32), np.zeros(size, np.float32)
    for n in np.unique(slab):
        here = (slab == n).any(0)
        cells = _cells(here.astype(np.float32), size)
        reached = cv2.dilate(cells, around) > 0
        mine = np.abs(radius_px[slab == n])
        spots = np.hypot(np.array([mine.min(), mine.max()]), aberrated)
        is_even = mine.max() - mine.min() < _EVEN_PX
        met += reached
        work += reached * (1.0 if is_even else _UNEVEN)
        low[reached] = np.minimum(low[reached], spots[0])
        high[reached] = np.maximum(high[reached], spots[1])
    count = np.where(high <= budget.few_px, rays.few.rays, rays.many.rays)
    step = np.array([step_for(float(r)) for r in low.ravel()]).reshape(size)
    cubic = np.where(low < budget.cubic_px, _CUBIC, 1.0)
    channels = len(rays.many.weight)
    each = _ALL_COLOURS if channels == 1 else channels
    moved = high > budget.unseen_px
    work = moved * work * count * cubic / step**2
    hidden = float(np.maximum(met - 1, 0).sum()) * TILE**2
    return float(work.sum()) * TILE**2 * each * _RAY_S, hidden


def _cells(here: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Whether anything is in each square of the frame."""
    more = size[0] * TILE - here.shape[0], size[1] * TILE - here.shape[1]
    filled = np.pad(here, ((0, more[0]), (0, more[1])))
    return filled.reshape(size[0], TILE, size[1], TILE).max((1, 3))

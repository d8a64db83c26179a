"""Sort the tiles of 8 x 16 pixels of a map by how they are read, once per map.

Within a tile a lens map is nearly a shift: its whole displacements differ by a few
pixels at most, the *levels* of the tile. Tiles of the same levels are read by the same
program from patches of the same size. Tiles with a position on a sample (which is
then copied), tiles across a discontinuity of the map, tiles at the edge of the source
and tiles with positions that are NaN belong to no class.
"""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float32, Int
from numpy.lib.stride_tricks import sliding_window_view

from lensfit.coords import Window
from lensfit.rendering.filters import Filter, first_tap
from lensfit.rendering.resample import TILE_HEIGHT, TILE_WIDTH
from lensfit.rendering.uv import SourceMap

MOST_LEVELS = 3
TORN = 2**30
"""First sample of a tile whose samples lie apart."""
CHUNK = 512
"""Tiles that are read at a time: what they read fits a processor's cache."""

Corners = Int[np.ndarray, "tiles 2"]
"""Row and column of the first pixel of each tile."""


@dataclass(frozen=True, eq=False)
class TileClass:
    """Tiles that one program reads; the last is repeated to fill a chunk.

    Attributes
    ----------
    levels : By how many the whole displacements within a tile differ at most.
    corners : Where the tiles lie in the output.
    starts : Where their first samples lie in the source, row and column.
    whole : Smallest whole displacement within each tile; x, y.
    """

    levels: int
    corners: Corners
    starts: Corners
    whole: Float32[np.ndarray, "tiles 2"]

    def chosen(self, which: np.ndarray) -> "TileClass":
        """Some of the tiles, at least one."""
        index = _whole_chunks(np.flatnonzero(which))
        return TileClass(
            self.levels, self.corners[index], self.starts[index], self.whole[index]
        )


@dataclass(frozen=True, eq=False)
class TilePlan:
    """How the tiles of a map are read from a source of a certain size.

    Attributes
    ----------
    classes : Tiles that lie wholly on the source.
    odd : Where other tiles lie in the output.
    odd_starts : Where their first samples lie in the source, or before it; far beyond
        it for tiles without positions and for those that a map tears apart.
    beside : Where tiles lie that read nothing of the source.
    """

    classes: tuple[TileClass, ...]
    odd: Corners
    odd_starts: Corners
    beside: Corners


_plans: WeakKeyDictionary[SourceMap, tuple[object, TilePlan]] = WeakKeyDictionary()


def has_tiles(window: Window) -> bool:
    """Whether a window is large enough for tiles to pay."""
    return window.height >= 4 * TILE_HEIGHT and window.width >= 4 * TILE_WIDTH


def tile_plan(source_map: SourceMap, source: Window, method: Filter) -> TilePlan:
    """The plan of a map for a source window, made once."""
    key = (source, method)
    known = _plans.get(source_map)
    if known is None or known[0] != key:
        known = (key, _make_plan(source_map, source, method))
        _plans[source_map] = known
    return known[1]


def reach_of(method: Filter, levels: int) -> int:
    """By how many samples a patch is larger than its tile."""
    return 1 - 2 * first_tap(method) + levels


def _make_plan(source_map: SourceMap, source: Window, method: Filter) -> TilePlan:
    window = source_map.window
    offset = np.array([window.y_min - source.y_min, window.x_min - source.x_min])
    corners = _tile_corners(window.height, window.width)
    tiles = sliding_window_view(
        source_map.displacement_px, (TILE_HEIGHT, TILE_WIDTH), axis=(1, 2)
    )[:, corners[:, 0], corners[:, 1]]
    flat = tiles.reshape(2, len(corners), -1)
    low, high = np.floor(flat.min(-1)), np.floor(flat.max(-1))
    copies = (flat == np.floor(flat)).all(0).any(-1)
    with np.errstate(invalid="ignore"):  # NaN is in no class
        levels = (high - low).max(0)
        # x, y to row, column.
        own = corners + offset
        start = own + low[::-1].T + first_tap(method)
        reach = reach_of(method, 0) + levels[:, None]
        end = start + reach + [TILE_HEIGHT, TILE_WIDTH]
        size = np.array([source.height, source.width])
        inside = (start >= 0).all(1) & (end <= size).all(1)
        plain = inside & (levels <= MOST_LEVELS) & ~copies
        last = own + high[::-1].T + [TILE_HEIGHT, TILE_WIDTH]
        beside = (last < 0).any(1) | (own + low[::-1].T > size).any(1)
    classes = []
    for count in range(MOST_LEVELS + 1):
        index = np.flatnonzero(plain & (levels == count))
        if len(index):
            index = _whole_chunks(index)
            starts = start[index].astype(np.intp)
            classes.append(TileClass(count, corners[index], starts, low[:, index].T))
    odd = ~plain & ~beside
    torn = ~(levels[odd] <= MOST_LEVELS)[:, None]
    return TilePlan(
        tuple(classes),
        corners[odd],
        np.where(torn, TORN, start[odd]).astype(np.intp),
        corners[beside],
    )


def _tile_corners(height: int, width: int) -> Corners:
    """Tiles that cover a window; the last of a row or a column overlap others."""
    rows = np.minimum(np.arange(0, height, TILE_HEIGHT), height - TILE_HEIGHT)
    columns = np.minimum(np.arange(0, width, TILE_WIDTH), width - TILE_WIDTH)
    return np.stack(np.meshgrid(rows, columns, indexing="ij"), -1).reshape(-1, 2)


def _whole_chunks(index: np.ndarray) -> np.ndarray:
    return np.concatenate([index, np.repeat(index[-1:], -len(index) % CHUNK)])

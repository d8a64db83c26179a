"""A warp on a CPU, tile by tile: samples are copied in rows, not looked up one by one.

The samples of some hundred tiles at a time are laid side by side by numpy and read
by `resample_tiles`, on two threads. OpenCV reads the ordinary tiles if its filter is
chosen. Tiles that a `TilePlan` puts in no class, and tiles that read infinity or NaN,
are left to `resample`.

Tiles of 8 x 16 pixels are sorted by how they are read, once per map. Within a tile a
lens map is nearly a shift: its whole displacements differ by a few pixels at most, the
*levels* of the tile. Tiles of the same levels are read by the same program from patches
of the same size. Tiles with a position on a sample (which is then copied), tiles across
a discontinuity of the map, tiles at the edge of the source and tiles with positions
that are NaN belong to no class.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple
from weakref import WeakKeyDictionary

import cv2
import numpy as np
from jaxtyping import Float32, Int, UInt32
from numpy.lib.stride_tricks import sliding_window_view

from lensfit.coords import Window
from lensfit.rendering.buffers import aligned_empty
from lensfit.rendering.filters import Filter, first_tap
from lensfit.rendering.resample import (
    TILE_HEIGHT,
    TILE_WIDTH,
    WHITE,
    Border,
    can_remap,
    lookup_of,
    remapped_pixels,
    resample,
    resample_tiles,
)
from lensfit.rendering.uv import SourceMap

MOST_LEVELS = 3
TORN = 2**30
"""First sample of a tile whose samples lie apart."""
CHUNK = 512
"""Tiles that are read at a time: what they read fits a processor's cache."""

Corners = Int[np.ndarray, "tiles 2"]
"""Row and column of the first pixel of each tile."""
_TILE = (TILE_HEIGHT, TILE_WIDTH)
_THREADS = 2
# Bits grow with the value; those of negative values and of NaN exceed all others.
_WHITE_BITS = np.float32(WHITE).view(np.uint32)
_INFINITE_BITS = np.float32(np.inf).view(np.uint32)
_FEW_TILES = 10_000
Pixels = Float32[np.ndarray, "height width channels"]


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


@dataclass(frozen=True, eq=False)
class TileWarp:
    """A picture whose channels share a map.

    Attributes
    ----------
    pixels : The source, in C order, over the window `source`.
    alpha_channel : The channel, if any, that is a coverage and stays below one.
    """

    pixels: Pixels
    source_map: SourceMap
    source: Window
    border: Border
    method: Filter
    alpha_channel: int | None = None

    def warped(self) -> Pixels:
        """The picture over the window of the map; minification is not looked at."""
        channels = self.pixels.shape[2]
        plan = tile_plan(self.source_map, self.source, self.method)
        read_already = self.method == "cubic" and can_remap(self.source, channels)
        if read_already:
            lookup = lookup_of(self.source_map, self.source)
            result = remapped_pixels(self.pixels, lookup, self.ceiling)
        else:
            window = self.source_map.window
            result = np.empty((window.height, window.width, channels), np.float32)
        placed = [
            sliding_window_view(result[..., c], _TILE, writeable=True)
            for c in range(channels)
        ]
        done = read_already and self._bits.of_blocks.max() <= _WHITE_BITS
        rest = []
        for kind in () if done else plan.classes:
            rest.append(self._read_class(kind, placed, read_already))
        if read_already:
            ordinary = self._read_bits(plan.odd_starts) <= _WHITE_BITS
            ordinary &= (plan.odd_starts < TORN).all(1)
            self._fade(plan.odd[ordinary], placed)
            rest.append(plan.odd[~ordinary])
        else:
            rest.append(plan.odd)
        if self.border == "clamp":
            rest.append(plan.beside)
        else:
            for view in placed:
                view[plan.beside[:, 0], plan.beside[:, 1]] = 0
        self._read_rest(np.concatenate(rest), placed)
        return result

    @cached_property
    def ceiling(self) -> Float32[np.ndarray, " channels"]:
        """Largest value of each channel; infinity for colour."""
        ceiling = np.full(self.pixels.shape[2], np.inf, np.float32)
        if self.alpha_channel is not None:
            ceiling[self.alpha_channel] = 1
            if self._bits.of_channels[self.alpha_channel] > _WHITE_BITS:
                alpha = self.pixels[..., self.alpha_channel]
                ceiling[self.alpha_channel] = max(1.0, float(alpha.max()))
        return ceiling

    @cached_property
    def _bits(self) -> "_LargestBits":
        return _LargestBits.of(self.pixels)

    def _read_bits(self, starts: Corners) -> UInt32[np.ndarray, " tiles"]:
        """The largest bits that tiles read, by their first samples."""
        blocks = np.maximum(starts, 0) // _TILE
        blocks = np.minimum(blocks, np.array(self._bits.of_blocks.shape) - 1)
        return self._bits.of_blocks[blocks[:, 0], blocks[:, 1]]

    def _fade(self, corners: Corners, placed: list) -> None:
        """Darken tiles at the edge of the source by the share of it they show."""
        if self.border == "clamp" or not len(corners):
            return
        window = self.source_map.window
        moved = sliding_window_view(self.source_map.displacement_px, _TILE, axis=(1, 2))
        at = moved[:, corners[:, 0], corners[:, 1]]
        rows, columns = corners.T[..., None, None] + np.indices(_TILE)[:, None]
        x = at[0] + (columns + (window.x_min - self.source.x_min))
        y = at[1] + (rows + (window.y_min - self.source.y_min))
        share = _share(x, self.source.width) * _share(y, self.source.height)
        for view in placed:
            view[corners[:, 0], corners[:, 1]] *= share

    def _read_class(self, kind: TileClass, placed: list, read_already: bool) -> Corners:
        """Read the tiles of a class; those that hold no numbers are returned.

        Tiles that need not be held to their neighbours read the same either way, so
        all are read as ordinary ones and the few others once more.
        """
        bits = self._read_bits(kind.starts)
        ordinary = bits <= _WHITE_BITS
        most = bool(ordinary.mean() > 0.5)
        if not (most and read_already):
            self._read_chunks(kind, most, placed)
        if most and not ordinary.all():
            self._read_chunks(kind.chosen(~ordinary), False, placed)
        doubtful = bits >= _INFINITE_BITS
        if not doubtful.any():
            return kind.corners[:0]
        chosen = kind.chosen(doubtful)
        finite = [
            np.isfinite(self._patches(chosen, chunk)).all((1, 2, 3))
            for chunk in _chunks(chosen.corners)
        ]
        return chosen.corners[~np.concatenate(finite)]

    def _read_chunks(self, kind: TileClass, ordinary: bool, placed: list) -> None:
        moved = sliding_window_view(self.source_map.displacement_px, _TILE, axis=(1, 2))

        def read(chunk: slice) -> None:
            rows, columns = kind.corners[chunk].T
            beyond = aligned_empty((len(rows), 2, *_TILE))
            whole = kind.whole[chunk].T[..., None, None]
            np.subtract(moved[:, rows, columns], whole, out=beyond.swapaxes(0, 1))
            tiles = resample_tiles(
                self._patches(kind, chunk),
                beyond,
                self.ceiling,
                method=self.method,
                levels=kind.levels,
                ordinary=ordinary,
            )
            _place(placed, kind.corners[chunk], np.asarray(tiles))

        _run_on_threads(read, _chunks(kind.corners))

    @cached_property
    def _planes(self) -> Float32[np.ndarray, "channels height width"]:
        planes = aligned_empty((self.pixels.shape[2], *self.pixels.shape[:2]))
        cv2.split(self.pixels, list(planes))
        return planes

    def _patches(self, kind: TileClass, chunk: slice) -> np.ndarray:
        """The samples that the tiles of a chunk read."""
        reach = reach_of(self.method, kind.levels)
        shape = TILE_HEIGHT + reach, TILE_WIDTH + reach
        rows, columns = kind.starts[chunk].T
        channels = self.pixels.shape[2]
        patches = aligned_empty((len(rows), channels, *shape))
        if len(kind.corners) < _FEW_TILES:
            at = sliding_window_view(self.pixels, (*shape, channels))[:, :, 0]
            patches[:] = np.moveaxis(at[rows, columns], 3, 1)
            return patches
        for channel, plane in enumerate(self._planes):
            patches[:, channel] = sliding_window_view(plane, shape)[rows, columns]
        return patches

    def _read_rest(self, corners: Corners, placed: list) -> None:
        """Tiles by looking every sample up."""
        if not len(corners):
            return
        pixels = aligned_empty(self.pixels.shape)
        pixels[:] = self.pixels
        window = self.source_map.window
        inside = np.indices(_TILE)

        def read(chunk: slice) -> None:
            count = len(corners[chunk])
            full = np.resize(corners[chunk], (CHUNK, 2))
            rows, columns = full.T[..., None, None] + inside[:, None]
            rows, columns = (a.reshape(-1, TILE_WIDTH) for a in (rows, columns))
            found = resample(
                pixels,
                self.source_map.displacement_px[:, rows, columns],
                (columns + window.x_min - self.source.x_min).astype(np.int32),
                (rows + window.y_min - self.source.y_min).astype(np.int32),
                self.ceiling,
                border=self.border,
                method=self.method,
            )
            tiles = np.asarray(found).reshape(CHUNK, *_TILE, -1)[:count]
            _place(placed, corners[chunk], np.moveaxis(tiles, 3, 1))

        _run_on_threads(read, _chunks(corners))


def _run_on_threads(work: Callable[[slice], None], chunks: Iterator[slice]) -> None:
    with ThreadPoolExecutor(_THREADS) as pool:
        for _ in pool.map(work, chunks):
            pass


def _chunks(corners: Corners) -> Iterator[slice]:
    for first in range(0, len(corners), CHUNK):
        yield slice(first, first + CHUNK)


def _place(placed: list, corners: Corners, tiles: np.ndarray) -> None:
    for channel, view in enumerate(placed):
        view[corners[:, 0], corners[:, 1]] = tiles[:, channel]


def _share(position: np.ndarray, size: int) -> np.ndarray:
    """As in `lensfit.rendering.resample`."""
    return np.clip(position + 1, 0, 1) * np.clip(size - position, 0, 1)


class _LargestBits(NamedTuple):
    """Bits of the largest samples.

    Attributes
    ----------
    of_blocks : Over 3 x 3 blocks of the size of a tile, from each block on: these hold
        what a tile reads whose first sample is in the block.
    of_channels : Over the whole picture.
    """

    of_blocks: UInt32[np.ndarray, "rows columns"]
    of_channels: UInt32[np.ndarray, " channels"]

    @classmethod
    def of(cls, pixels: Pixels) -> "_LargestBits":
        height, width, channels = pixels.shape
        bits = pixels.view(np.uint32).reshape(height, -1)
        rows, columns = -(-height // TILE_HEIGHT), -(-width // TILE_WIDTH)
        lines = np.zeros((rows, columns * TILE_WIDTH * channels), np.uint32)
        whole = height // TILE_HEIGHT
        full = bits[: whole * TILE_HEIGHT].reshape(whole, TILE_HEIGHT, bits.shape[1])

        def read(part: slice) -> None:
            np.max(full[part], 1, out=lines[:whole][part, : bits.shape[1]])

        _run_on_threads(read, (slice(first, first + 8) for first in range(0, whole, 8)))
        if whole < rows:
            lines[whole, : bits.shape[1]] = bits[whole * TILE_HEIGHT :].max(0)
        blocks = lines.reshape(rows, columns, -1).max(2)
        blocks = np.pad(blocks, ((0, 2), (0, 2)), mode="edge")
        in_reach = sliding_window_view(blocks, (3, 3)).max((2, 3))
        return cls(in_reach, lines.max(0).reshape(-1, channels).max(0))

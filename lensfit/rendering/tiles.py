"""A warp on a CPU, tile by tile: samples are copied in rows, not looked up one by one.

The samples of some hundred tiles at a time are laid side by side by numpy and read
by `resample_tiles`, on two threads. OpenCV reads the ordinary tiles if its filter is
chosen. Tiles that a `TilePlan` puts in no class, and tiles that read infinity or NaN,
are left to `resample`.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt32
from numpy.lib.stride_tricks import sliding_window_view

from lensfit.coords import Window
from lensfit.rendering.buffers import aligned_empty
from lensfit.rendering.filters import Filter
from lensfit.rendering.remap import can_remap, lookup_of, remapped
from lensfit.rendering.resample import (
    TILE_HEIGHT,
    TILE_WIDTH,
    WHITE,
    Border,
    resample,
    resample_tiles,
)
from lensfit.rendering.tile_plan import (
    CHUNK,
    TORN,
    Corners,
    TileClass,
    reach_of,
    tile_plan,
)
from lensfit.rendering.uv import SourceMap

_TILE = (TILE_HEIGHT, TILE_WIDTH)
_THREADS = 2
# Bits grow with the value; those of negative values and of NaN exceed all others.
_WHITE_BITS = np.float32(WHITE).view(np.uint32)
_INFINITE_BITS = np.float32(np.inf).view(np.uint32)
_FEW_TILES = 10_000

Pixels = Float32[np.ndarray, "height width channels"]


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
            result = remapped(self.pixels, lookup, self.ceiling)
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

        _on_threads(read, _chunks(kind.corners))

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

        _on_threads(read, _chunks(corners))


def _on_threads(work: Callable[[slice], None], chunks: Iterator[slice]) -> None:
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

        _on_threads(read, (slice(first, first + 8) for first in range(0, whole, 8)))
        if whole < rows:
            lines[whole, : bits.shape[1]] = bits[whole * TILE_HEIGHT :].max(0)
        blocks = lines.reshape(rows, columns, -1).max(2)
        blocks = np.pad(blocks, ((0, 2), (0, 2)), mode="edge")
        in_reach = sliding_window_view(blocks, (3, 3)).max((2, 3))
        return cls(in_reach, lines.max(0).reshape(-1, channels).max(0))

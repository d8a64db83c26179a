"""Resample a picture at the positions a map gives, in scene-linear float32.

- No shift: pixel centres are at halves on both sides, so the identity map returns the
  picture bit for bit, and so does a map that moves by whole pixels.
- Edge: the picture is continued by its border pixels and multiplied by the share of
  the reading pixel's square that lies on it ("black": premultiplied colour and alpha
  fade together over exactly one pixel), or simply continued ("clamp"). Positions
  that are NaN read as 0 in either case.
- Highlights: a cubic undershoots below zero by a light; `lensfit.rendering.resample`
  describes the limit. Radiance that was not negative stays so, a highlight gets no
  rings, and alpha does not exceed 1.
- Minification: where the map steps by more than `UNFILTERED_STRETCH` source pixels per
  output pixel, the reading is averaged over a parallelogram that grows with the
  stretch from zero size, so that detail fades instead of aliasing. A step of more than
  `JUMP_PX` is a discontinuity between two parts of a map, and is not averaged.

On a CPU most of the picture is read in tiles (`lensfit.rendering.tiles`), on a GPU
pixel by pixel; the values are the same to rounding.
"""

from collections.abc import Iterator, Sequence
from functools import partial

import cv2
import jax
import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window
from lensfit.rendering.filters import Filter
from lensfit.rendering.resample import Border, resample
from lensfit.rendering.tiles import TileWarp, has_tiles
from lensfit.rendering.uv import SourceMap

UNFILTERED_STRETCH = 1.25
JUMP_PX = 32.0
_MOST_READINGS = 16
"""Along each axis of the parallelogram; more take time and look the same."""
_STRETCHED_TILE = 128
_STRETCH_STEP = 8


def warp(
    pixels: Float32[np.ndarray, "height width channels"],
    source_window: Window,
    maps: SourceMap | Sequence[SourceMap],
    *,
    border: Border = "black",
    method: Filter = "cubic",
    alpha_channel: int | None = None,
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """The picture that reads `pixels` where the maps say.

    Parameters
    ----------
    pixels : Any number of channels; colour premultiplied if there is alpha.
    source_window : Where those pixels lie, in the pixel space of the maps.
    maps : One map for all channels, or one for each.
    border : What lies outside `source_window`.
    method : Interpolating filter.
    alpha_channel : Index of the channel that is a coverage.

    Raises
    ------
    ValueError : The window does not fit the pixels, the maps do not fit the channels.
    """
    pixels = np.asarray(pixels, np.float32)
    count = pixels.shape[-1]
    if pixels.shape[:2] != (source_window.height, source_window.width):
        raise ValueError(f"pixels of shape {pixels.shape} do not fill {source_window}")
    each = [maps] * count if isinstance(maps, SourceMap) else list(maps)
    if len(each) != count or len({m.window for m in each}) != 1:
        raise ValueError("give one map, or one map of the same window per channel")
    pixels, parts = np.ascontiguousarray(pixels), list(_groups(each, method))
    results = []
    for source_map, channels in parts:
        part = pixels if len(channels) == count else pixels[..., channels].copy()
        alpha = channels.index(alpha_channel) if alpha_channel in channels else None
        task = TileWarp(part, source_map, source_window, border, method, alpha)
        results.append(_warp_one(task))
    if len(parts) == 1:
        return results[0]
    result = np.empty((*results[0].shape[:2], count), np.float32)
    for (_, channels), part in zip(parts, results, strict=True):
        result[..., channels] = part
    return result


def _warp_one(task: TileWarp) -> np.ndarray:
    """Channels by one map: one reading each, then several where it minifies."""
    window, source = task.source_map.window, task.source
    displacement = task.source_map.displacement_px
    shift = _whole_shift(displacement)
    if shift is not None:
        return _copied_samples(task, shift)
    minified = list(_minified_tiles(displacement))
    in_tiles = (
        jax.default_backend() == "cpu" and has_tiles(window) and has_tiles(source)
    )
    result = task.warped() if in_tiles else None
    if result is not None and not minified:
        return result
    own = np.indices((window.height, window.width), np.int32, sparse=True)
    row = own[0] + np.int32(window.y_min - source.y_min)
    column = own[1] + np.int32(window.x_min - source.x_min)
    read = partial(
        resample,
        jax.device_put(task.pixels),
        ceiling=task.ceiling,
        border=task.border,
        method=task.method,
    )
    if result is None:
        result = np.array(read(displacement, column, row))
    for tile in minified:
        readings = [
            np.asarray(read(moved, column[:, tile[1]], row[tile[0]]))
            for moved in _spread(displacement, tile)
        ]
        result[tile] = np.mean(readings, 0, np.float64)
    return result


def _whole_shift(displacement: np.ndarray) -> tuple[int, int] | None:
    """Columns and rows by which a map moves the whole picture, if that is all."""
    first = displacement[:, :1, :1]
    if not (first == np.floor(first)).all() or (displacement != first).any():
        return None
    return int(first[0, 0, 0]), int(first[1, 0, 0])


def _copied_samples(task: TileWarp, shift: tuple[int, int]) -> np.ndarray:
    """Samples moved by whole pixels, bit for bit."""
    window, source = task.source_map.window, task.source
    columns = np.arange(window.width) + window.x_min - source.x_min + shift[0]
    rows = np.arange(window.height) + window.y_min - source.y_min + shift[1]
    x = np.clip(columns, 0, source.width - 1)
    y = np.clip(rows, 0, source.height - 1)
    result = task.pixels[y[0] : y[-1] + 1] if (y == rows).all() else task.pixels[y]
    result = result[:, x]
    if task.border == "black":
        result[y != rows] = 0
        result[:, x != columns] = 0
    return result


def _minified_tiles(displacement: np.ndarray) -> Iterator[tuple[slice, slice]]:
    """Tiles that hold a pixel whose step is longer than may go unfiltered."""
    _, height, width = displacement.shape
    coarse = displacement[:, ::_STRETCH_STEP, ::_STRETCH_STEP]
    if min(coarse.shape[1:]) < 2:
        return
    long = _stretch(coarse, _STRETCH_STEP).max(0) > UNFILTERED_STRETCH
    if not long.any():
        return
    for top in range(0, height, _STRETCHED_TILE):
        for left in range(0, width, _STRETCHED_TILE):
            y = slice(
                max(0, min(top, height - _STRETCHED_TILE)),
                min(top + _STRETCHED_TILE, height),
            )
            x = slice(
                max(0, min(left, width - _STRETCHED_TILE)),
                min(left + _STRETCHED_TILE, width),
            )
            if long[_coarse(y), _coarse(x)].any():
                yield y, x


def _coarse(pixels: slice) -> slice:
    return slice(pixels.start // _STRETCH_STEP, -(-pixels.stop // _STRETCH_STEP))


def _stretch(displacement: np.ndarray, step: int) -> np.ndarray:
    """Length of one output step in the source, along x and along y."""
    return np.linalg.norm(_steps(displacement, step), axis=1)


def _steps(displacement: np.ndarray, step: int = 1) -> np.ndarray:
    """d source / d output: (axis of the output, component of the source, y, x)."""
    along_y, along_x = np.gradient(displacement, step, axis=(1, 2))
    identity = np.eye(2, dtype=np.float32)[:, :, None, None]
    return np.nan_to_num(np.stack([along_x, along_y])) + identity


def _spread(displacement: np.ndarray, tile: tuple[slice, slice]) -> list[np.ndarray]:
    """Displacements of the readings whose mean replaces one reading in a tile.

    They lie evenly over a share w of the output pixel, w^2 = 1 - (limit/stretch)^2:
    nothing where the stretch is at its limit, the whole pixel where it is large.
    """
    _, height, width = displacement.shape
    halo = tuple(
        slice(max(0, s.start - 1), min(n, s.stop + 1))
        for s, n in zip(tile, (height, width), strict=True)
    )
    inner = tuple(
        slice(t.start - h.start, t.stop - h.start)
        for t, h in zip(tile, halo, strict=True)
    )
    steps = _steps(displacement[(slice(None), *halo)])[(..., *inner)]
    stretch = np.linalg.norm(steps, axis=1)
    stretch[:, (stretch > JUMP_PX).any(0)] = 1.0
    over = np.maximum(stretch / UNFILTERED_STRETCH, 1.0)
    wide = np.sqrt(1 - over**-2)
    counts = np.clip(np.ceil((wide * stretch).max((1, 2))), 1, _MOST_READINGS)
    own = displacement[(slice(None), *tile)]
    x_step, y_step = wide[:, None] * steps
    return [
        (own + a * x_step + b * y_step).astype(np.float32)
        for a in _even(int(counts[0]))
        for b in _even(int(counts[1]))
    ]


def _even(count: int) -> np.ndarray:
    """Midpoints of `count` equal parts of [-1/2, 1/2]."""
    return (np.arange(count) + 0.5) / count - 0.5


def _groups(
    maps: list[SourceMap], method: Filter
) -> Iterator[tuple[SourceMap, list[int]]]:
    """Each distinct map with channels that read by it; as many at a time as OpenCV
    reads fast, where it may do it."""
    for source_map in {id(m): m for m in maps}.values():
        channels = [c for c, m in enumerate(maps) if m is source_map]
        size = len(channels)
        if method == "cubic" and size not in (1, 3, 4):
            size = 1
        for first in range(0, len(channels), size):
            yield source_map, channels[first : first + size]


def nearest(
    plane: Float32[np.ndarray, "height width"],
    source_window: Window,
    source_map: SourceMap,
) -> Float32[np.ndarray, "out_height out_width"]:
    """The sample nearest to each position of the map; the border goes on beyond it.

    Parameters
    ----------
    source_window : Where `plane` lies, in the pixel space of the map.
    """
    method = cv2.INTER_NEAREST
    return _read(plane, source_window, source_map, method, cv2.BORDER_REPLICATE)


def linear(
    plane: Float32[np.ndarray, "height width"],
    source_window: Window,
    source_map: SourceMap,
) -> Float32[np.ndarray, "out_height out_width"]:
    """The mean of the four samples around each position of the map, to 1/64 px; black
    beyond the border."""
    method = cv2.INTER_LINEAR
    return _read(plane, source_window, source_map, method, cv2.BORDER_CONSTANT)


def _read(
    plane: Float32[np.ndarray, "height width"],
    source_window: Window,
    source_map: SourceMap,
    method: int,
    border: int,
) -> Float32[np.ndarray, "out_height out_width"]:
    """The same plane where the map moves nothing."""
    if source_map.window == source_window and not source_map.displacement_px.any():
        return plane
    x, y = _read_at(source_window, source_map)
    return cv2.remap(plane, x, y, method, borderMode=border)


def _read_at(
    source_window: Window, source_map: SourceMap
) -> tuple[
    Float32[np.ndarray, "out_height out_width"],
    Float32[np.ndarray, "out_height out_width"],
]:
    """Columns and rows of the source, pixel centres whole."""
    window = source_map.window
    x, y = np.nan_to_num(source_map.displacement_px)
    x = x + np.arange(window.x_min, window.x_max + 1, dtype=np.float32)
    y = y + np.arange(window.y_min, window.y_max + 1, dtype=np.float32)[:, None]
    return x - np.float32(source_window.x_min), y - np.float32(source_window.y_min)

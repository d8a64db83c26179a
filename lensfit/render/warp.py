"""Resample a picture at the positions a map gives, in scene-linear float32.

- No shift: pixel centres are at halves on both sides, so the identity map returns the
  picture bit for bit, and so does a map that moves by whole pixels.
- Edge: the picture is continued by its border pixels and multiplied by the share of
  the reading pixel's square that lies on it ("black": premultiplied colour and alpha
  fade together over exactly one pixel), or simply continued ("clamp"). Positions
  that are NaN read as 0 in either case.
- Highlights: a cubic swings below zero beside a light a thousand times its
  surroundings. The result is therefore held within one stop of the four nearest
  samples (half the darkest, twice the brightest), which ordinary detail never
  reaches, and nearer than that where another sample that is read is more than
  `ORDINARY_CONTRAST` times the brightest of the four. Radiance that was not negative
  stays so, and a highlight gets no rings. Alpha does not exceed 1.
- Minification: where the map steps by more than `UNFILTERED_STRETCH` source pixels per
  output pixel, the reading is averaged over a parallelogram that grows with the
  stretch from zero size, so that detail fades instead of aliasing.

`resample` is a pure JAX function: the same code runs on a GPU.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int

from lensfit.coords import Window
from lensfit.render.buffers import aligned_empty
from lensfit.render.filters import Filter, first_tap, tap_weights
from lensfit.render.uv import SourceMap

Border = Literal["black", "clamp"]
UNFILTERED_STRETCH = 1.25
ORDINARY_CONTRAST = 8.0
_TILE = 128
_STRETCH_STEP = 8
_FARTHEST_PX = 1e6
_DARKEST = 1e-30


def warp(
    pixels: Float32[np.ndarray, "height width channels"],
    source_window: Window,
    maps: SourceMap | Sequence[SourceMap],
    *,
    border: Border = "black",
    method: Filter = "catmull-rom",
    alpha_channel: int | None = None,
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """The picture that reads `pixels` where the maps say.

    Parameters
    ----------
    pixels : Any number of channels; colour premultiplied if there is alpha.
    source_window : Where those pixels lie, in the pixel space of the maps.
    maps : One map for all channels, or one for each. Channels that share a map
        (the same object) are read together.
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
    ceiling = _ceiling(pixels, alpha_channel)
    groups = list(_groups(each))
    if len(groups) == 1:
        return _warp_one(pixels, source_window, each[0], border, method, ceiling)
    result = np.empty((each[0].window.height, each[0].window.width, count), np.float32)
    for source_map, channels in groups:
        part = aligned_empty((*pixels.shape[:2], len(channels)))
        part[:] = pixels[..., channels]
        result[..., channels] = _warp_one(
            part, source_window, source_map, border, method, ceiling[channels]
        )
    return result


@partial(jax.jit, static_argnames=("border", "method"))
def resample(
    pixels: Float[Array, "height width channels"],
    displacement: Float[Array, "2 out_height out_width"],
    offset: Int[Array, "2"],
    ceiling: Float[Array, " channels"],
    *,
    border: Border = "black",
    method: Filter = "catmull-rom",
) -> Float[Array, "out_height out_width channels"]:
    """One reading per output pixel.

    Parameters
    ----------
    pixels : Source, float32.
    displacement : Source position minus own position, px; x plane, y plane.
    offset : Column and row in the source of the first output pixel, int32.
    ceiling : Largest value of each channel; infinity for colour.
    """
    height, width, channels = pixels.shape
    valid = jnp.isfinite(displacement).all(0)
    moved = jnp.clip(
        jnp.where(valid[None], displacement, 0), -_FARTHEST_PX, _FARTHEST_PX
    )
    columns, x, dx = _split(moved[0], offset[0], axis=1)
    rows, y, dy = _split(moved[1], offset[1], axis=0)

    first = first_tap(method)
    x_weights, y_weights = tap_weights(method, dx), tap_weights(method, dy)
    taps = range(first, first + len(x_weights))
    at_column = [jnp.clip(columns + k, 0, width - 1) for k in taps]
    at_row = [jnp.clip(rows + k, 0, height - 1) * width for k in taps]
    flat = pixels.reshape(-1, channels)

    zero = jnp.zeros((), pixels.dtype)
    total, peak, nearest = zero, zero, []
    for j, row in enumerate(at_row):
        line = zero
        for i, column in enumerate(at_column):
            tap = flat.at[row + column].get(mode="promise_in_bounds")
            line = line + tap * x_weights[i][..., None]
            peak = jnp.maximum(peak, jnp.abs(tap))
            if taps[i] in (0, 1) and taps[j] in (0, 1):
                nearest.append(tap)
        total = total + line * y_weights[j][..., None]

    total = _within_one_stop(total, nearest, peak, ceiling)
    on_sample = (dx == 0) & (dy == 0)
    total = jnp.where(on_sample[..., None], nearest[0], total)
    if border == "black":
        total = total * (_share(x, width) * _share(y, height))[..., None]
    return jnp.where(valid[..., None], total, 0)


def _split(moved: Array, offset: Array, axis: int) -> tuple[Array, Array, Array]:
    """Index of the sample at or below the position, the position in indices, and the
    fraction between; the fraction comes from the small displacement alone."""
    whole = jnp.floor(moved)
    own = jax.lax.broadcasted_iota(jnp.int32, moved.shape, axis) + offset
    index = whole.astype(jnp.int32) + own
    fraction = moved - whole
    return index, index.astype(moved.dtype) + fraction, fraction


def _within_one_stop(
    value: Array, nearest: list[Array], peak: Array, ceiling: Array
) -> Array:
    """`value` held to a stop around the range of the nearest samples, or to less
    where the largest sample that was read is out of proportion to them."""
    low, high = nearest[0], nearest[0]
    for sample in nearest[1:]:
        low, high = jnp.minimum(low, sample), jnp.maximum(high, sample)
    own = jnp.maximum(jnp.abs(low), jnp.abs(high))
    room = jnp.minimum(1, ORDINARY_CONTRAST * own / jnp.maximum(peak, _DARKEST))
    low, high = low - 0.5 * room * jnp.abs(low), high + room * jnp.abs(high)
    return jnp.clip(value, low, jnp.minimum(high, ceiling[None, None]))


def _share(position: Array, size: int) -> Array:
    """Share, along one axis, of the unit square about a position that is on the
    picture; position 0 is the centre of the first sample."""
    return jnp.clip(position + 1, 0, 1) * jnp.clip(size - position, 0, 1)


def _warp_one(
    pixels: np.ndarray,
    source_window: Window,
    source_map: SourceMap,
    border: Border,
    method: Filter,
    ceiling: np.ndarray,
) -> np.ndarray:
    """All channels by one map: one reading each, then several where it minifies."""
    window = source_map.window
    offset = np.array(
        [window.x_min - source_window.x_min, window.y_min - source_window.y_min],
        np.int32,
    )
    source = jax.device_put(pixels)
    read = partial(resample, source, ceiling=ceiling, border=border, method=method)
    result = np.asarray(read(source_map.displacement_px, offset))
    tiles = list(_minified_tiles(source_map.displacement_px))
    if tiles:
        result = result.copy()
    for tile in tiles:
        corner = np.array([tile[1].start, tile[0].start], np.int32)
        readings = _spread(source_map.displacement_px, tile)
        total = sum(np.asarray(read(d, offset + corner), np.float64) for d in readings)
        result[tile] = total / len(readings)
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
    for top in range(0, height, _TILE):
        for left in range(0, width, _TILE):
            y = slice(max(0, min(top, height - _TILE)), min(top + _TILE, height))
            x = slice(max(0, min(left, width - _TILE)), min(left + _TILE, width))
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
    over = np.maximum(stretch / UNFILTERED_STRETCH, 1.0)
    wide = np.sqrt(1 - over**-2)
    counts = np.maximum(np.ceil((wide * stretch).max((1, 2))), 1).astype(int)
    own = displacement[(slice(None), *tile)]
    x_step, y_step = wide[:, None] * steps
    return [
        (own + a * x_step + b * y_step).astype(np.float32)
        for a in _even(counts[0])
        for b in _even(counts[1])
    ]


def _even(count: int) -> np.ndarray:
    """Midpoints of `count` equal parts of [-1/2, 1/2]."""
    return (np.arange(count) + 0.5) / count - 0.5


def _groups(maps: list[SourceMap]) -> Iterator[tuple[SourceMap, list[int]]]:
    """Each distinct map with the channels that read by it."""
    for source_map in {id(m): m for m in maps}.values():
        yield source_map, [c for c, m in enumerate(maps) if m is source_map]


def _ceiling(pixels: np.ndarray, alpha_channel: int | None) -> np.ndarray:
    """No limit for colour; 1 for alpha, unless the source itself goes beyond."""
    ceiling = np.full(pixels.shape[-1], np.inf, np.float32)
    if alpha_channel is not None:
        ceiling[alpha_channel] = max(1.0, float(np.max(pixels[..., alpha_channel])))
    return ceiling

"""One sample per output pixel: filter, overshoot limit, edge. In JAX, or by OpenCV.

`resample` reads anywhere and runs on any device. `resample_tiles` reads small tiles
whose samples were laid side by side before, so that a CPU loads them in rows: a tile's
whole displacements differ by a few pixels at most, and every pixel is a sum over the
same samples with weights that are zero beyond its own taps. Both give the same
values to rounding.

Limit: a cubic undershoots below zero beside a light a thousand times its surroundings.
Where a sample above `WHITE` or below zero is read, the result is limited to within one
stop of the four nearest samples (half the darkest, twice the brightest), which ordinary
detail never reaches, and to a narrower range where another sample that is read is more
than `ORDINARY_CONTRAST` times the brightest of the four. Elsewhere the overshoot is a
part of the display range, and the result is only kept above zero. Alpha does not exceed
1.

OpenCV's cubic is the fastest on a CPU (`remapped_pixels`). Since version 5, `cv2.remap`
weights samples by the exact fraction of a position; before, by the nearest thirty-
second of a pixel. Positions for it are moved to where its kernel reproduces a ramp
(`filters.ramp_fraction`). In absolute pixels, float32 has a resolution of 1.2e-4 px at
UHD.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache, partial
from typing import Literal, NamedTuple
from weakref import WeakKeyDictionary

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int

from lensfit.coords import Window
from lensfit.rendering.filters import Filter, first_tap, ramp_fraction, tap_weights
from lensfit.rendering.uv import SourceMap

Border = Literal["black", "clamp"]
ORDINARY_CONTRAST = 8.0
WHITE = 1.0
TILE_HEIGHT, TILE_WIDTH = 8, 16
_FARTHEST_PX = 1e6
_DARKEST = 1e-30
_BAND = 16
_THREADS = 2
_LONGEST_SIDE_PX = 32_000
Lookup = tuple[np.ndarray, np.ndarray]
"""Column and row planes as `cv2.remap` takes them; its pixel centres are integers."""


@partial(jax.jit, static_argnames=("border", "method"))
def resample(
    pixels: Float[Array, "height width channels"],
    displacement: Float[Array, "2 out_height out_width"],
    column: Int[Array, "#out_height out_width"],
    row: Int[Array, "out_height #out_width"],
    ceiling: Float[Array, " channels"],
    *,
    border: Border = "black",
    method: Filter = "cubic",
) -> Float[Array, "out_height out_width channels"]:
    """Read anywhere.

    Parameters
    ----------
    pixels : Source, float32.
    displacement : Source position minus own position, px; x plane, y plane.
    column, row : Own position of each output pixel in the source, int32.
    ceiling : Largest value of each channel; infinity for colour.
    """
    height, width, channels = pixels.shape
    valid = jnp.isfinite(displacement).all(0)
    moved = jnp.clip(
        jnp.where(valid[None], displacement, 0), -_FARTHEST_PX, _FARTHEST_PX
    )
    columns, x, dx = _index_and_fraction(moved[0], column)
    rows, y, dy = _index_and_fraction(moved[1], row)

    first = first_tap(method)
    x_weights, y_weights = tap_weights(method, dx), tap_weights(method, dy)
    taps = range(first, first + len(x_weights))
    at_column = [jnp.clip(columns + k, 0, width - 1) for k in taps]
    at_row = [jnp.clip(rows + k, 0, height - 1) * width for k in taps]
    flat = pixels.reshape(-1, channels)

    total, lines, nearest = jnp.zeros((), pixels.dtype), [], []
    for j, line_start in enumerate(at_row):
        read = [
            flat.at[line_start + c].get(mode="promise_in_bounds") for c in at_column
        ]
        total = total + y_weights[j][..., None] * _weighted_sum(
            read, [w[..., None] for w in x_weights]
        )
        lines.append(_Extremes.of(read))
        if taps[j] in (0, 1):
            nearest += [read[-first], read[1 - first]]

    total = _limited_value(
        total, _Extremes.of(nearest), _Extremes.joined(lines), ceiling[None, None]
    )
    on_sample = (dx == 0) & (dy == 0)
    total = jnp.where(on_sample[..., None], nearest[0], total)
    if border == "black":
        total = total * (_share(x, width) * _share(y, height))[..., None]
    return jnp.where(valid[..., None], total, 0)


@partial(jax.jit, static_argnames=("method", "levels", "ordinary"))
def resample_tiles(
    patches: Float[Array, "tiles channels patch_height patch_width"],
    beyond: Float[Array, "tiles 2 tile_height tile_width"],
    ceiling: Float[Array, " channels"],
    *,
    method: Filter,
    levels: int,
    ordinary: bool,
) -> Float[Array, "tiles channels tile_height tile_width"]:
    """Read tiles that lie wholly on the picture.

    Parameters
    ----------
    patches : The samples that each tile reads: its own size and, along either axis,
        one sample less than the filter has taps, and `levels` more.
    beyond : Displacement of each pixel less the smallest whole one of its tile, in
        [0, levels + 1); x, y.
    ceiling : Largest value of each channel; infinity for colour.
    levels : By how many the whole displacements of a tile may differ.
    ordinary : No sample of these tiles is negative or above `WHITE`.
    """
    # A displacement of -1e-9 px, less -1, rounds to 1: the end of level 0, not level 1.
    level = jnp.minimum(jnp.floor(beyond), levels)
    fraction = beyond - level
    x_level, y_level = level[:, None, 0], level[:, None, 1]
    x_weights = _weights_at_level(
        tap_weights(method, fraction[:, None, 0]), x_level, levels
    )
    y_weights = _weights_at_level(
        tap_weights(method, fraction[:, None, 1]), y_level, levels
    )
    total, lines, pairs = jnp.zeros((), patches.dtype), [], []
    centre = -first_tap(method)
    taps = range(2 * centre + 2)
    for j, y_weight in enumerate(y_weights):
        read = [_shifted_patches(patches, j, i) for i in range(len(x_weights))]
        total = total + y_weight * _weighted_sum(read, x_weights)
        if not ordinary:
            own = [_choice(read[i:], x_level, levels) for i in taps]
            lines.append(_Extremes.of(own))
            pairs.append(_Extremes.of(own[centre : centre + 2]))
    ceiling = ceiling[None, :, None, None]
    if ordinary:
        return jnp.clip(total, 0, ceiling)
    all_lines = [_extremes_at(lines[j:], y_level, levels) for j in taps]
    near = [_extremes_at(pairs[j:], y_level, levels) for j in taps[centre : centre + 2]]
    return _limited_value(
        total, _Extremes.joined(near), _Extremes.joined(all_lines), ceiling
    )


def _shifted_patches(patches: Array, row: int, column: int) -> Array:
    return patches[..., row : row + TILE_HEIGHT, column : column + TILE_WIDTH]


def _weighted_sum(samples: list[Array], weights: list[Array]) -> Array:
    total = samples[0] * weights[0]
    for sample, weight in zip(samples[1:], weights[1:], strict=True):
        total = total + sample * weight
    return total


def _weights_at_level(weights: list[Array], level: Array, levels: int) -> list[Array]:
    """Weights of all samples of a patch: a pixel's own taps begin at its level."""
    zero = jnp.zeros_like(weights[0])
    padded = [zero] * levels + weights + [zero] * levels
    count = len(weights) + levels
    return [
        _choice(padded[k : k + levels + 1][::-1], level, levels) for k in range(count)
    ]


def _choice(options: list[Array], level: Array, levels: int) -> Array:
    """`options[level]` of each pixel."""
    chosen = options[0]
    for k in range(1, levels + 1):
        chosen = jnp.where(level == k, options[k], chosen)
    return chosen


class _Extremes(NamedTuple):
    """The smallest and the largest of some samples."""

    low: Array
    high: Array

    @classmethod
    def of(cls, samples: list[Array]) -> "_Extremes":
        low = high = samples[0]
        for sample in samples[1:]:
            low, high = jnp.minimum(low, sample), jnp.maximum(high, sample)
        return cls(low, high)

    @classmethod
    def joined(cls, parts: list["_Extremes"]) -> "_Extremes":
        return cls(
            cls.of([part.low for part in parts]).low,
            cls.of([part.high for part in parts]).high,
        )


def _extremes_at(lines: list[_Extremes], level: Array, levels: int) -> _Extremes:
    return _Extremes(
        _choice([line.low for line in lines], level, levels),
        _choice([line.high for line in lines], level, levels),
    )


def _limited_value(
    value: Array, near: _Extremes, read: _Extremes, ceiling: Array
) -> Array:
    """`value` held above zero, or to a stop around the nearest samples where any that
    is read is beyond the display range, or to less where that one is out of
    proportion to them."""
    own = jnp.maximum(jnp.abs(near.low), jnp.abs(near.high))
    peak = jnp.maximum(jnp.abs(read.low), jnp.abs(read.high))
    room = jnp.minimum(1, ORDINARY_CONTRAST * own / jnp.maximum(peak, _DARKEST))
    ordinary = (read.low >= 0) & (read.high <= WHITE)
    low = jnp.where(ordinary, 0, near.low - 0.5 * room * jnp.abs(near.low))
    high = jnp.where(ordinary, jnp.inf, near.high + room * jnp.abs(near.high))
    return jnp.clip(value, low, jnp.minimum(high, ceiling))


def _index_and_fraction(moved: Array, own: Array) -> tuple[Array, Array, Array]:
    """Index of the sample at or below the position, the position in indices, and the
    fraction between; the fraction comes from the small displacement alone."""
    whole = jnp.floor(moved)
    index = whole.astype(jnp.int32) + own
    fraction = moved - whole
    return index, index.astype(moved.dtype) + fraction, fraction


def _share(position: Array, size: int) -> Array:
    """Share, along one axis, of the unit square about a position that is on the
    picture; position 0 is the centre of the first sample."""
    return jnp.clip(position + 1, 0, 1) * jnp.clip(size - position, 0, 1)


def can_remap(source: Window, channels: int) -> bool:
    """Whether this OpenCV reads such pictures exactly."""
    short = max(source.width, source.height) <= _LONGEST_SIDE_PX
    return short and channels in (1, 3, 4) and _weighs_exactly()


@cache
def _weighs_exactly() -> bool:
    point = np.zeros((9, 9), np.float32)
    point[4, 4] = 1
    found = cv2.remap(
        point, np.array([[4.01]], np.float32), np.array([[4.0]], np.float32), 2
    )
    return bool(abs(found[0, 0] - (1 - 2.25e-4 + 1.25e-6)) < 1e-6)


_lookups: WeakKeyDictionary[SourceMap, tuple[Window, Lookup]] = WeakKeyDictionary()


def lookup_of(source_map: SourceMap, source: Window) -> Lookup:
    """Where a map reads a source, made once."""
    known = _lookups.get(source_map)
    if known is None or known[0] != source:
        window = source_map.window
        first = window.x_min - source.x_min, window.y_min - source.y_min
        planes = _positions(source_map.displacement_px, np.array(first, np.int32))
        known = (source, (np.asarray(planes[0]), np.asarray(planes[1])))
        _lookups[source_map] = known
    return known[1]


@jax.jit
def _positions(displacement: Array, first: Array) -> tuple[Array, Array]:
    planes = []
    for axis, moved in enumerate(displacement):
        own = jax.lax.broadcasted_iota(jnp.int32, moved.shape, 1 - axis) + first[axis]
        whole = jnp.floor(moved)
        moved_in = whole + jnp.where(moved == whole, 0, ramp_fraction(moved - whole))
        planes.append(jnp.nan_to_num(own.astype(moved.dtype) + moved_in, nan=-1e6))
    return planes[0], planes[1]


def remapped_pixels(
    pixels: Float32[np.ndarray, "height width channels"],
    lookup: Lookup,
    ceiling: Float32[np.ndarray, " channels"],
) -> Float32[np.ndarray, "out_height out_width channels"]:
    """Every output pixel, held between zero and the ceiling; the source is continued by
    its border pixels.

    Parameters
    ----------
    pixels : Source, in C order.
    lookup : Where to read it.
    ceiling : Largest value of each channel; infinity for colour.
    """
    columns, rows = lookup
    height, width, channels = *columns.shape, pixels.shape[2]
    result = np.empty((height, width, channels), np.float32)
    lines = result.reshape(height, -1)
    highest = np.tile(ceiling, width) if np.isfinite(ceiling).any() else None

    def read(first: int) -> None:
        # Bands are small: they are held to their limits while in a processor's cache.
        band = slice(first, first + _BAND)
        at = columns[band], rows[band]
        cv2.remap(pixels, *at, cv2.INTER_CUBIC, result[band], cv2.BORDER_REPLICATE)
        cv2.threshold(lines[band], 0, 0, cv2.THRESH_TOZERO, lines[band])
        if highest is not None:
            np.minimum(lines[band], highest, out=lines[band])

    with ThreadPoolExecutor(_THREADS) as pool:
        for _ in pool.map(read, range(0, height, _BAND)):
            pass
    return result

"""OpenCV's cubic warp, the fastest on a CPU.

Since version 5, `cv2.remap` weights samples by the exact fraction of a position;
before, by the nearest thirty-second of a pixel. Positions here are moved to where its
kernel reproduces a ramp (`filters.ramp_fraction`). In absolute pixels, float32 has a
resolution of 1.2e-4 px at UHD.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import cache
from weakref import WeakKeyDictionary

import cv2
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float32

from lensfit.coords import Window
from lensfit.rendering.filters import ramp_fraction
from lensfit.rendering.uv import SourceMap

_BAND = 16
_THREADS = 2
_LONGEST_SIDE_PX = 32_000

Lookup = tuple[np.ndarray, np.ndarray]
"""Column and row planes as `cv2.remap` takes them; its pixel centres are integers."""


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


def remapped(
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

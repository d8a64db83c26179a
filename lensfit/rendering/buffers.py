"""Aligned arrays that JAX on a CPU uses without a copy, and crops of a window.

JAX copies an array that does not start on a 64-byte boundary, which numpy's seldom do;
for a frame of eight million pixels the copy costs as much as half a warp.
"""

import math

import numpy as np
from jaxtyping import Float32

from lensfit.coords import Window

_ALIGNMENT = 64


def aligned_empty(shape: tuple[int, ...]) -> Float32[np.ndarray, "..."]:
    """An uninitialised float32 array on such a boundary."""
    count = 4 * math.prod(shape)
    buffer = np.empty(count + _ALIGNMENT, np.uint8)
    start = -buffer.ctypes.data % _ALIGNMENT
    return buffer[start : start + count].view(np.float32).reshape(shape)


def crop(
    pixels: Float32[np.ndarray, "height width *channels"],
    window: Window,
    wanted: Window,
) -> Float32[np.ndarray, "out_height out_width *channels"]:
    """The part of `pixels`, which lie on `window`, that lies on `wanted`.

    Raises
    ------
    ValueError : `wanted` reaches beyond `window`.
    """
    top, left = wanted.y_min - window.y_min, wanted.x_min - window.x_min
    inside = wanted.x_max <= window.x_max and wanted.y_max <= window.y_max
    if min(top, left) < 0 or not inside:
        raise ValueError(f"{wanted} is not inside {window}")
    return pixels[top : top + wanted.height, left : left + wanted.width]

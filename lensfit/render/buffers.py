"""Memory that JAX on a CPU can use in place.

JAX copies an array that does not start on a 64-byte boundary, which numpy's seldom do;
for a frame of eight million pixels the copy costs as much as half a warp.
"""

import math

import numpy as np
from jaxtyping import Float32

_ALIGNMENT = 64


def aligned_empty(shape: tuple[int, ...]) -> Float32[np.ndarray, "..."]:
    """An uninitialised float32 array on such a boundary."""
    count = 4 * math.prod(shape)
    buffer = np.empty(count + _ALIGNMENT, np.uint8)
    start = -buffer.ctypes.data % _ALIGNMENT
    return buffer[start : start + count].view(np.float32).reshape(shape)

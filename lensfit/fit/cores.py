"""The processor's cores, among which a pass over the data is shared.

What a pass does for one mark, or one dot, is too little for several cores to share,
and marks need nothing of each other: each core takes every so many-th, and what they
find is summed. JAX counts cores as devices (`lensfit._jax` asks for them); on a
graphics card there is one.
"""

from functools import cache

import jax
import numpy as np
from jax.sharding import Mesh

AXIS = "cores"


@cache
def cores() -> Mesh:
    """The largest power of two of them, which divides the room of any pass."""
    devices = jax.local_devices()
    count = 1 << (len(devices).bit_length() - 1)
    return Mesh(np.array(devices[:count]), (AXIS,))

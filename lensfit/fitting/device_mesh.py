"""A pass over the data, sharded over the processor's cores.

The work for one detection, or one dot, is too little to be divided, and detections are
independent: with n cores, each core takes every n-th, and the results are summed. JAX
counts cores as devices (`lensfit._jax` requests them); a graphics card counts as one.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Int

_AXIS = "cores"
_Parts = TypeVar("_Parts")
SHARED: Any = PartitionSpec()
"""Of arrays that every core has whole."""
SHARDED: Any = PartitionSpec(_AXIS)
"""Sharding of arrays whose rows are distributed over the cores."""


@cache
def cores() -> Mesh:
    """The largest power of two of them, which divides the room of any pass."""
    devices = jax.local_devices()
    count = 1 << (len(devices).bit_length() - 1)
    return Mesh(np.array(devices[:count]), (_AXIS,))


def on_every_core(
    function: Callable[..., _Parts], takes: Any, gives: Any
) -> Callable[..., _Parts]:
    """The function as every core runs it, on its own share of what it takes.

    Parameters
    ----------
    takes, gives : `SHARED` or `SHARDED`, for each argument and for what comes back, or
        trees of them. Results that are shared must be alike on all cores.
    """
    # Loops carry sums that begin as constants, which JAX's own check calls a mistake.
    return jax.shard_map(
        function, mesh=cores(), in_specs=takes, out_specs=gives, check_vma=False
    )


def summed_over_cores(parts: _Parts) -> _Parts:
    """Within such a function: every array of the tree added up over all cores."""
    return jax.tree.map(lambda part: jax.lax.psum(part, _AXIS), parts)


def this_core() -> Int[Array, ""]:
    """Within such a function: which of the cores runs it, from 0."""
    return jax.lax.axis_index(_AXIS)

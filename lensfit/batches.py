"""Apply a compiled function to many rows, in batches of one size.

A program is compiled for the shapes of its arrays: a function that is always called
with the same number of rows is compiled once, whatever number of them is wanted.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import numpy as np

BATCH = 4096
_THREADS = 2


def in_batches(function: Callable[[Any], Any], rows: Any, size: int = BATCH) -> Any:
    """`function` of all rows, called with `size` rows at a time.

    Parameters
    ----------
    function : One value, of any shape, for each row, independent of the other rows; or
        a tree of such arrays.
    rows : At least one, an array or a tree of arrays; the last is repeated to fill its
        batch.
    size : Rows of a batch.

    Returns
    -------
    NumPy arrays, as many rows as were given.
    """
    count = len(jax.tree.leaves(rows)[0])
    padding = -count % size

    def padded(array: Any) -> np.ndarray:
        array = np.asarray(array)
        return np.concatenate([array, np.repeat(array[-1:], padding, 0)])

    def joined(*parts: np.ndarray) -> np.ndarray:
        return np.concatenate(parts)[:count]

    whole = jax.tree.map(padded, rows)
    batches = (
        jax.tree.map(lambda array, k=k: array[k : k + size], whole)
        for k in range(0, count + padding, size)
    )

    def found(batch: Any) -> Any:
        return jax.tree.map(np.asarray, function(batch))

    # A program that works through its rows one by one keeps one core busy.
    with ThreadPoolExecutor(_THREADS) as pool:
        return jax.tree.map(joined, *pool.map(found, batches))

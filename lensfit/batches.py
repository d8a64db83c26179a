"""Many rows through a compiled function, in batches of one size.

A program is compiled for the shapes of its arrays: a function that is always called
with the same number of rows is compiled once, whatever number of them is wanted.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

BATCH = 4096


def in_batches(
    function: Callable[[np.ndarray], object],
    rows: Float[np.ndarray, "rows ..."],
    size: int = BATCH,
) -> Float[np.ndarray, "rows ..."]:
    """`function` of all rows, called with `size` rows at a time.

    Parameters
    ----------
    function : One value, of any shape, for each row, independent of the other rows.
    rows : At least one; the last is repeated to fill its batch.
    size : Rows of a batch.
    """
    padding = -len(rows) % size
    padded = np.concatenate([rows, np.repeat(rows[-1:], padding, 0)])
    batches = padded.reshape(-1, size, *rows.shape[1:])
    return np.concatenate([np.asarray(function(b)) for b in batches])[: len(rows)]

"""What a file that keeps colour at lower resolution lost of the dots.

Light of one channel goes to the others there, and fringes of a pixel become wider: a
lens fitted to that is more blurred than it is. The fit predicts the loss: of light m
that it draws, the file would give back J(m) (`chroma`). Photographed light d is taken
as d + m - J(m), so that a residual is d - J(m), the file against the model's file. A
fit that starts from there and predicts anew ends where these agree.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.chroma import codes_after_storage
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.io.transfer import decode, encode


def restore_colour(
    dot_data: DotData, modelled: Float[np.ndarray, "dots 3 rows columns"]
) -> DotData:
    """The same with light as a file without that loss would have it."""
    stored = dot_data.as_stored
    if stored is None:
        return dot_data
    light = stored.light.copy()
    for k, photograph in enumerate(dot_data.photographs):
        kept = photograph.dot_images.stored
        if kept is None:
            continue
        mine = dot_data.take == k
        around = stored.surround[mine][..., None, None]
        # Dark dots are how much they take.
        seen = np.where(around > 0, around - modelled[mine], modelled[mine])
        codes = encode(np.maximum(seen, 0.0), kept.encoding)
        given = codes_after_storage(codes, stored.corner_px[mine], kept.blocks)
        lost = decode(codes, kept.encoding) - decode(given, kept.encoding)
        light[mine] += np.where(around > 0, -lost, lost)
    return replace(dot_data, light=light)

"""Where a floating point photograph is clipped, although nothing says so.

A sensor's noise gives the brightest pixels of a picture values of their own; where it
clips, many have the very same one, and few lie just below it. A picture with a large
bright ground that was drawn rather than photographed has such values too: a plateau
that covers much of the picture is not taken for clipping.
"""

import numpy as np
from jaxtyping import Float

_FEWEST_PIXELS = 16
_LARGEST_SHARE = 0.25
_JUST_BELOW = 0.97


def ceiling_of(pixels: Float[np.ndarray, "height width channels"]) -> float:
    """Value at which the photograph clips; infinite if no channel shows that it does.

    The lowest of the channels' ceilings, since one number stands for all.
    """
    found = [_of_channel(pixels[..., k]) for k in range(pixels.shape[2])]
    return min(found, default=float("inf"))


def _of_channel(channel: Float[np.ndarray, "height width"]) -> float:
    top = float(np.nanmax(channel, initial=0.0))
    if not 0 < top < np.inf:
        return float("inf")
    near = channel[channel >= _JUST_BELOW * top]
    at_top = int(np.count_nonzero(near == top))
    enough = _FEWEST_PIXELS <= at_top <= _LARGEST_SHARE * channel.size
    return top if enough and 2 * at_top > near.size else float("inf")

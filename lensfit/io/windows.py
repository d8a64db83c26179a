"""Resample the extent of pixels from one OpenEXR data window to another."""

import numpy as np
from jaxtyping import Num

from lensfit.coords import Window


def pixels_over_window(
    samples: Num[np.ndarray, "height width *channels"],
    own: Window,
    wanted: Window,
    missing: float = 0,
) -> Num[np.ndarray, "new_height new_width *channels"]:
    """The same samples over another window; a view where that is a part of their own.

    Parameters
    ----------
    own : Where `samples` lie.
    wanted : Where they are wanted.
    missing : Value of what lies outside `own`.
    """
    top, left = wanted.y_min - own.y_min, wanted.x_min - own.x_min
    if min(top, left) >= 0 and wanted.x_max <= own.x_max and wanted.y_max <= own.y_max:
        return samples[top : top + wanted.height, left : left + wanted.width]
    size = (wanted.height, wanted.width, *samples.shape[2:])
    result = np.full(size, missing, samples.dtype)
    x0, x1 = max(own.x_min, wanted.x_min), min(own.x_max, wanted.x_max) + 1
    y0, y1 = max(own.y_min, wanted.y_min), min(own.y_max, wanted.y_max) + 1
    if x0 < x1 and y0 < y1:
        result[
            y0 - wanted.y_min : y1 - wanted.y_min, x0 - wanted.x_min : x1 - wanted.x_min
        ] = samples[y0 - own.y_min : y1 - own.y_min, x0 - own.x_min : x1 - own.x_min]
    return result

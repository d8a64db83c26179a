"""The green light of a photograph, reduced to the size of a page.

It is kept while the lens is fitted, so that the photograph need not be read again to be
shown beside the model's. Light is scene-linear, averaged over the area of each small
pixel, in units of its own highlights; half precision (three digits) is more than a page
shows. Row 0 on top; small pixel (column 0, row 0) covers [0, 1) x [0, 1).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float16

from lensfit.photograph import Photograph

WIDEST_PX = 1400
_HIGHLIGHTS = 99.9
"""Percentile that becomes one."""
_LARGEST = 1e3


@dataclass(frozen=True, eq=False)
class SmallPhotograph:
    """Green light of a photograph (grey, if it has one channel).

    Attributes
    ----------
    light : Scene-linear, in units of the photograph's highlights.
    scale : Small pixels per pixel of the photograph, across and down.
    """

    light: Float16[np.ndarray, "height width"]
    scale: tuple[float, float]


def small_of(photograph: Photograph) -> SmallPhotograph:
    """A photograph reduced until its longer side is no longer than `WIDEST_PX`."""
    full = photograph.size_px
    factor = min(1.0, WIDEST_PX / max(full))
    size = tuple(max(1, round(side * factor)) for side in full)
    light = np.nan_to_num(photograph.luminance_channel, posinf=0.0, neginf=0.0)
    if size != full:
        light = cv2.resize(light, size, interpolation=cv2.INTER_AREA)
    highlights = float(np.percentile(light[::2, ::2], _HIGHLIGHTS))
    unit = highlights if highlights > 0 else 1.0
    kept = np.clip(light / unit, -_LARGEST, _LARGEST).astype(np.float16)
    return SmallPhotograph(kept, (size[0] / full[0], size[1] / full[1]))

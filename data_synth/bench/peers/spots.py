"""What peers and lensfit have in common: point-spread functions at a stated setting."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from jaxtyping import ArrayLike, Float

from lensfit.lens import Channel


class DrawsSpots(Protocol):
    """A lens at one f-number and focus distance, as far as its peers go."""

    def psf(
        self,
        image_point_mm: ArrayLike,
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float,
        size_px: int,
    ) -> Float[np.ndarray, "size size"]:
        """Light on pixels around the chief ray, row 0 on top; sums to 1."""
        ...


LensMaker = Callable[[float, float], DrawsSpots]
"""Of f-number and focus distance, mm."""

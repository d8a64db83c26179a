"""The sensor: its area in mm, its pixels, and the way between the two.

Sensor millimetres are upright: origin at the centre, x right, y down.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class Frame:
    """The sensor's area and its pixels."""

    size_px: tuple[int, int]
    size_mm: tuple[float, float]

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """Width and height of a pixel."""
        return self.size_mm[0] / self.size_px[0], self.size_mm[1] / self.size_px[1]

    def px_from_mm(self, sensor_mm: Float[np.ndarray, "*points 2"]):
        """Pixels of upright sensor positions."""
        return sensor_mm / np.array(self.pitch_mm) + np.array(self.size_px) / 2

    def mm_from_px(self, position_px: Float[np.ndarray, "*points 2"]):
        """Upright sensor positions of pixels."""
        return (position_px - np.array(self.size_px) / 2) * np.array(self.pitch_mm)

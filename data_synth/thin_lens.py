"""A thin lens, which every judged lens should beat: no aberration, a disc for blur."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_synth.sensor import Channel

_FINE = 5
"""Samples along a pixel."""


@dataclass(frozen=True)
class ThinLens:
    """Perfect projection, a disc for blur, fall-off by the fourth power of the cosine.

    The disc: |S2 - S1|/S2 f^2/(N (S1 - f)), S1 the focus and S2 the object distance,
    both from the lens.
    """

    focal_length_mm: float
    f_number: float
    focus_distance_mm: float

    def project(
        self, object_points_mm, channel: Channel = "g"
    ) -> Float[np.ndarray, "n 2"]:
        points = np.asarray(object_points_mm, float)
        image_mm = self._image_distance_mm()
        return points[:, :2] * image_mm / (points[:, 2:] - image_mm)

    def relative_illumination(
        self, points_mm, channel: Channel = "g"
    ) -> Float[np.ndarray, " n"]:
        radius_mm = np.hypot(*np.asarray(points_mm, float).T)
        return 1 / (1 + (radius_mm / self.focal_length_mm) ** 2) ** 2

    def psf(
        self,
        image_point_mm,
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float,
        size_px: int,
    ) -> Float[np.ndarray, "size size"]:
        image_mm = self._image_distance_mm()
        focus_mm = self.focus_distance_mm - image_mm
        object_mm = object_distance_mm - image_mm
        blur = abs(1 / focus_mm - 1 / object_mm) * focus_mm
        blur *= self.focal_length_mm**2 / (
            self.f_number * (focus_mm - self.focal_length_mm)
        )
        radius_px = max(blur / 2 / pixel_pitch_mm, 0.5)
        fine = _FINE
        place = (np.arange(size_px * fine) + 0.5) / fine - size_px / 2
        disc = radius_px + 0.5 / fine - np.hypot(place[:, None], place[None])
        disc = np.clip(disc * fine, 0.0, 1.0)
        disc = disc.reshape(size_px, fine, size_px, fine).sum(axis=(1, 3))
        return disc / disc.sum()

    def _image_distance_mm(self) -> float:
        """v of u + v = S and 1/u + 1/v = 1/f."""
        half = self.focus_distance_mm / 2
        return half - math.sqrt(half**2 - 2 * half * self.focal_length_mm)

"""What a judge asks of a lens: where points land, how bright they are, and spots.

Sensor mm with x right and y down, object points with z from the sensor. It is what
lenses of `lensfit` answer, written again: the tracer and its judge import none of them.
"""

from typing import Protocol

from jaxtyping import ArrayLike

from data_synth.bands import Channel


class SpotLens(Protocol):
    """What is judged of point-spread functions alone."""

    def psf(
        self,
        image_point_mm: ArrayLike,
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float,
        size_px: int,
    ) -> ArrayLike:
        """Spot around the green chief ray, summing to 1."""
        ...


class Lens(SpotLens, Protocol):
    """What is judged: the part of a lensfit lens that a photograph can prove."""

    def project(self, object_points_mm: ArrayLike, channel: Channel = "g") -> ArrayLike:
        """Sensor mm of object points."""
        ...

    def relative_illumination(
        self, points_mm: ArrayLike, channel: Channel = "g"
    ) -> ArrayLike:
        """Brightness against the middle."""
        ...

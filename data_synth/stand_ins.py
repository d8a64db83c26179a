"""Lenses to try a judge on: the ray tracer itself, a thin lens, and a wrong sign.

All answer as `lensfit` lenses do: `project`, `relative_illumination` and `psf`, sensor
mm with x right and y down, object points with z from the sensor.
"""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from jaxtyping import ArrayLike, Float

from data_synth.bands import CHANNELS, Band, Channel
from data_synth.irradiance import plane_irradiance
from data_synth.lens import SetLens
from data_synth.spots import (
    band_chiefs_mm,
    band_maps,
    drawn_spots,
    object_points_mm,
)


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


@dataclass(frozen=True, eq=False)
class TracedLens:
    """The exact ray tracer dressed as a lens: nothing can be closer to its truth."""

    lens: SetLens
    bands: tuple[Band, ...]
    light_distance_mm: float

    def project(
        self, object_points_mm, channel: Channel = "g"
    ) -> Float[np.ndarray, "n 2"]:
        points = np.asarray(object_points_mm, float)
        return band_chiefs_mm(self.lens, points, self._band(channel))

    def relative_illumination(
        self, points_mm, channel: Channel = "g"
    ) -> Float[np.ndarray, " n"]:
        places = np.concatenate([np.asarray(points_mm, float), np.zeros((1, 2))])
        objects = object_points_mm(self.lens, places, self.light_distance_mm)
        wavelengths_nm = self._band(channel).wavelengths_nm
        middle_nm = wavelengths_nm[len(wavelengths_nm) // 2]
        light = plane_irradiance(self.lens, objects, middle_nm)
        return light[:-1] / light[-1]

    def psf(
        self,
        image_point_mm,
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float,
        size_px: int,
    ) -> Float[np.ndarray, "size size"]:
        place = np.asarray(image_point_mm, float).reshape(1, 2)
        points = object_points_mm(self.lens, place, object_distance_mm)
        band = self._band(channel)
        maps = band_maps(self.lens, points, band)
        pitch_mm = np.full(2, pixel_pitch_mm)
        return drawn_spots(maps, band, self.lens, place, pitch_mm, size_px)[0]

    def _band(self, channel: Channel) -> Band:
        return self.bands[CHANNELS.index(channel)]


@dataclass(frozen=True)
class ThinLens:
    """Perfect projection, a disc for blur, fall-off by the fourth power of the cosine.

    The disc: |S2 - S1|/S2 f^2/(N (S1 - f)), S1 the focus and S2 the object distance,
    both from the lens.
    """

    focal_length_mm: float
    f_number: float
    focus_distance_mm: float
    oversampling: int = field(default=5)

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
        fine = self.oversampling
        place = (np.arange(size_px * fine) + 0.5) / fine - size_px / 2
        disc = radius_px + 0.5 / fine - np.hypot(place[:, None], place[None])
        disc = np.clip(disc * fine, 0.0, 1.0)
        disc = disc.reshape(size_px, fine, size_px, fine).sum(axis=(1, 3))
        return disc / disc.sum()

    def _image_distance_mm(self) -> float:
        """v of u + v = S and 1/u + 1/v = 1/f."""
        half = self.focus_distance_mm / 2
        return half - math.sqrt(half**2 - 2 * half * self.focal_length_mm)


@dataclass(frozen=True, eq=False)
class FlippedLens:
    """Another lens, its blur taken from the other side of focus."""

    lens: Lens
    focus_distance_mm: float

    def project(self, object_points_mm, channel: Channel = "g"):
        return self.lens.project(object_points_mm, channel)

    def relative_illumination(self, points_mm, channel: Channel = "g"):
        return self.lens.relative_illumination(points_mm, channel)

    def psf(
        self,
        image_point_mm,
        object_distance_mm: float,
        channel: Channel = "g",
        *,
        pixel_pitch_mm: float,
        size_px: int,
    ):
        mirrored = mirrored_distance_mm(self.focus_distance_mm, object_distance_mm)
        return self.lens.psf(
            image_point_mm,
            mirrored,
            channel,
            pixel_pitch_mm=pixel_pitch_mm,
            size_px=size_px,
        )


def mirrored_distance_mm(focus_mm: float, object_mm: float) -> float:
    """The distance that is as much out of focus on the other side, in dioptres."""
    dioptres = 2 / focus_mm - 1 / object_mm
    return 1 / max(dioptres, 1e-7)

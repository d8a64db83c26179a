"""Lenses to try a judge on: the ray tracer itself, and a wrong sign of defocus."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_synth.irradiance import plane_irradiance
from data_synth.judge_spots import mirrored_distance_mm
from data_synth.judged_lens import Lens
from data_synth.lens import SetLens
from data_synth.sensor import CHANNELS, Band, Channel
from data_synth.spots import (
    band_chiefs_mm,
    band_maps,
    drawn_spots,
    object_points_mm,
)


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


@dataclass(frozen=True, eq=False)
class FlippedLens:
    """Another lens, its blur taken from the other side of focus."""

    lens: Lens
    focus_distance_mm: float

    def project(self, object_points_mm, channel: Channel = "g"):
        return self.lens.project(object_points_mm, channel)

    def relative_illumination(self, points_mm, channel: Channel = "g"):
        return self.lens.relative_illumination(points_mm, channel)

    def psf(self, image_point_mm, object_distance_mm: float, *channel, **raster):
        mirrored = mirrored_distance_mm(self.focus_distance_mm, object_distance_mm)
        return self.lens.psf(image_point_mm, mirrored, *channel, **raster)

"""Light of small lamps, traced forward from each disc through all of the pupil.

A ray from lamp area dA to entrance-pupil area dB at distance s carries
dA cos(lamp) dB cos(axis) / s^2 of the lamp's radiance (`data_synth.irradiance`), times
what nearer layers let through along that very ray. It is counted in the pixel where it
lands, which is exactly the integral over the pixel's area.
"""

import numpy as np
from jaxtyping import Float

from data_synth.aim import pupil_bounds_mm, rays_through_pupil
from data_synth.irradiance import ray_weights, shifted_sobol
from data_synth.lens import SetLens
from data_synth.scene.crossings import share_let_through
from data_synth.scene.layers import Layer, Scene, SceneRays
from data_synth.scene.sampling import SHARES, seed_of
from data_synth.sensor import CHANNELS, Band, Frame

RAYS_TO_MEASURE = 256
LEAST_RAYS, MOST_RAYS = 1 << 9, 1 << 18


def lamp_light(
    lens: SetLens,
    scene: Scene,
    frame: Frame,
    bands: tuple[Band, ...],
    white: list[float],
    *,
    rays_per_pixel: int,
    seed: int,
) -> Float[np.ndarray, "height width 3"]:
    """Irradiance of all lamps; 1 is the given irradiance of white in each channel.

    Parameters
    ----------
    rays_per_pixel : Of a channel, for each pixel that a lamp's light covers.
    """
    image = np.zeros((frame.size_px[1], frame.size_px[0], len(CHANNELS)))
    for number, layer in enumerate(scene.layers):
        if layer.lamps is None:
            continue
        others = scene.layers[:number] + scene.layers[number + 1 :]
        centre_mm = _tracer_mm(lens, layer.plane.scene_mm(layer.lamps.centre_mm))
        bounds = pupil_bounds_mm(lens, centre_mm, 540.0)
        for lamp, box in enumerate(zip(*bounds, strict=True)):
            one = _Lamp(lens, layer, lamp, others, box, frame)
            count = one.rays_wanted(rays_per_pixel)
            if count:
                own = seed_of(seed, number, lamp)
                image += one.light(bands, count, own) * (
                    layer.lamps.radiance[lamp] / np.array(white)
                )
    return image


class _Lamp:
    """One lamp, what may stand before it, and the box of the pupil it shines into."""

    def __init__(self, lens, layer: Layer, number: int, others, box, frame: Frame):
        assert layer.lamps is not None
        self._lens, self._layer, self._others, self._frame = lens, layer, others, frame
        self._centre_mm = layer.lamps.centre_mm[number]
        self._radius_mm = float(layer.lamps.radius_mm[number])
        self._lower, self._sides = box[0], box[1] - box[0]

    def rays_wanted(self, rays_per_pixel: int) -> int:
        """Rays of an outer wavelength, a sixth of all; 0 if none meets the frame."""
        if not (self._sides > 0).all():
            return 0
        landing, flux = self.traced(RAYS_TO_MEASURE, 0, 540.0, hidden=False)
        landing = landing[flux > 0]
        if not len(landing):
            return 0
        low, high = landing.min(axis=0) - 2, landing.max(axis=0) + 2
        if (high < 0).any() or (low > self._frame.size_px).any():
            return 0
        wanted = float(np.prod(high - low)) * rays_per_pixel / sum(SHARES)
        return int(2 ** np.ceil(np.log2(np.clip(wanted, LEAST_RAYS, MOST_RAYS))))

    def light(self, bands: tuple[Band, ...], count: int, seed: int):
        """Irradiance (height, width, 3) for a radiance of 1."""
        width, height = self._frame.size_px
        image = np.zeros((height, width, len(bands)))
        for channel, band in enumerate(bands):
            for k, wavelength_nm in enumerate(band.wavelengths_nm):
                own = seed_of(seed, channel, k)
                landing, flux = self.traced(SHARES[k] * count, own, wavelength_nm)
                _collect(image[..., channel], landing, flux * band.weights[k])
        return image / np.prod(self._frame.pitch_mm)

    def traced(
        self, count: int, seed: int, wavelength_nm: float, *, hidden: bool = True
    ) -> tuple[Float[np.ndarray, "rays 2"], Float[np.ndarray, " rays"]]:
        """Where rays land, px, and the flux of each for a radiance of 1.

        Parameters
        ----------
        hidden : Whether nearer layers hide the lamp.
        """
        drawn = shifted_sobol(4, count, 1, seed)[0]
        radius, azimuth = np.sqrt(drawn[:, 0]), 2 * np.pi * drawn[:, 1]
        disc = radius[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
        source = self._layer.plane.scene_mm(self._centre_mm + self._radius_mm * disc)
        pupil = self._lower + self._sides * drawn[:, 2:]
        points = _tracer_mm(self._lens, source)
        traced, direction = rays_through_pupil(self._lens, points, pupil, wavelength_nm)
        normals = np.broadcast_to(self._layer.plane.normal, points.shape)
        flux = ray_weights(self._lens, points, normals * [1, 1, -1], direction)
        flux = flux * np.prod(self._sides) * np.pi * self._radius_mm**2 / count
        some = traced.passed
        landing = self._frame.px_from_mm(-traced.landing_mm[some])
        flux = flux[some]
        if hidden:
            depth = source[some, 2]
            slope = (source[some, :2] - pupil[some]) / depth[:, None]
            flux = flux * share_let_through(
                self._others, SceneRays(pupil[some], slope), depth
            )
        return landing, flux


def _tracer_mm(lens: SetLens, scene_mm: Float[np.ndarray, "points 3"]):
    """Tracer frame of scene coordinates."""
    return scene_mm * np.array([1.0, 1.0, -1.0]) + np.array([0, 0, lens.pupil_z_mm])


def _collect(plane: Float[np.ndarray, "height width"], landing_px, flux) -> None:
    """Add each ray's flux to the pixel it lands in."""
    height, width = plane.shape
    column, row = np.floor(landing_px).astype(np.int64).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    flat = row[inside] * width + column[inside]
    plane += np.bincount(flat, flux[inside], height * width).reshape(plane.shape)

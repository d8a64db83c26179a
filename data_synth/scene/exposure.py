"""The photograph of a scene by brute force: rays from every pixel through the lens.

Each ray starts at a point of a pixel and leaves the sensor at a slope; both are drawn
jointly from a scrambled Sobol sequence, another copy for each pixel. A ray of slopes
u, v brings the irradiance L cos^4 du dv of the radiance L that it meets, cos being that
of its angle to the axis at the sensor. The mean radiance with these weights, over the
rays that pass, times the irradiance of an open white scene
(`data_synth.scene.open_light`) is the pixel: how many rays happen to pass makes no
noise. Lamps are too small and bright for that and are added by
`data_synth.scene.lamp_light`.

Everything is done in a few independent exposures, whose scatter gives the standard
error of their mean at every pixel. Three wavelengths of a channel share the rays in
proportion to their weights (1 : 4 : 1).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from data_synth.irradiance import shifted_sobol
from data_synth.lens import SetLens
from data_synth.scene.backward import BackwardLens, Openings, backward_lens, openings
from data_synth.scene.crossings import radiance_along
from data_synth.scene.lamp_light import lamp_light
from data_synth.scene.layers import Scene
from data_synth.scene.open_light import axis_irradiance, open_irradiance
from data_synth.scene.sampling import SHARES, Sampling, seed_of
from data_synth.sensor import CHANNELS, Band, Frame, camera_bands

RAYS_AT_ONCE = 1 << 18


@dataclass(frozen=True, eq=False)
class Exposed:
    """A noise-free photograph, but for what finitely many rays leave.

    Attributes
    ----------
    image : Irradiance; 1 is that of a white surface on the axis at this stop.
    standard_error : Of each sample, from the scatter of the exposures.
    """

    image: Float[np.ndarray, "height width 3"]
    standard_error: Float[np.ndarray, "height width 3"]


def expose_scene(
    lens: SetLens,
    scene: Scene,
    frame: Frame,
    sampling: Sampling | None = None,
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> Exposed:
    """Photograph a scene through a lens.

    Parameters
    ----------
    seed : The same seed gives the same photograph.
    progress : Told what is being done.
    """
    sampling = sampling or Sampling()
    bands = camera_bands(len(SHARES))
    backward = backward_lens(lens)
    where = openings(backward, frame.size_mm)
    white = [axis_irradiance(backward, band) for band in bands]
    open_light = [
        open_irradiance(backward, frame, band) / on_axis
        for band, on_axis in zip(bands, white, strict=True)
    ]
    total = np.zeros((frame.size_px[1], frame.size_px[0], len(CHANNELS)))
    square = np.zeros_like(total)
    for number in range(sampling.exposures):
        progress(f"exposure {number + 1} of {sampling.exposures}")
        image = lamp_light(
            lens, scene, frame, bands, white,
            rays_per_pixel=sampling.lamp_rays_per_pixel, seed=seed_of(seed, number, 1),
        )  # fmt: skip
        for channel, band in enumerate(bands):
            own = seed_of(seed, number, 2, channel)
            image[..., channel] += open_light[channel] * mean_radiance(
                backward, where, scene, frame, band, channel,
                rays_per_pixel=sampling.rays_per_pixel, seed=own,
            )  # fmt: skip
        total += image
        square += image**2
    mean = total / sampling.exposures
    scatter = np.maximum(square / sampling.exposures - mean**2, 0.0)
    return Exposed(mean, np.sqrt(scatter / (sampling.exposures - 1)))


def mean_radiance(
    backward: BackwardLens,
    where: Openings,
    scene: Scene,
    frame: Frame,
    band: Band,
    channel: int,
    *,
    rays_per_pixel: int,
    seed: int,
) -> Float[np.ndarray, "height width"]:
    """Radiance of all surfaces but lamps, mean over all rays that reach each pixel.

    Parameters
    ----------
    rays_per_pixel : Of an outer wavelength.
    """
    width, height = frame.size_px
    light, weight = np.zeros(width * height), np.zeros(width * height)
    at_once = max(1, RAYS_AT_ONCE // (sum(SHARES) * rays_per_pixel))
    for start in range(0, width * height, at_once):
        pixel = np.arange(start, min(start + at_once, width * height))
        corner_px = np.stack([pixel % width, pixel // width], -1)
        for k, wavelength_nm in enumerate(band.wavelengths_nm):
            count = SHARES[k] * rays_per_pixel
            drawn = shifted_sobol(4, count, len(pixel), seed_of(seed, start, k))
            px = (corner_px[:, None] + drawn[..., :2]).reshape(-1, 2)
            rays, passed, brought = _rays_of_slopes(
                backward, where, frame.mm_from_px(px),
                drawn[..., 2:].reshape(-1, 2), wavelength_nm,
            )  # fmt: skip
            seen = np.zeros(len(px))
            seen[passed] = radiance_along(scene, rays, channel) * brought[passed]
            light[pixel] += seen.reshape(len(pixel), count).sum(axis=1)
            weight[pixel] += brought.reshape(len(pixel), count).sum(axis=1)
    mean = np.divide(light, weight, out=np.zeros_like(light), where=weight > 0)
    return mean.reshape(height, width)


def _rays_of_slopes(
    backward: BackwardLens, where: Openings, sensor_mm, drawn, wavelength_nm: float
):
    """Rays from sensor positions, drawn in the unit square over each one's opening.

    Returns
    -------
    rays : Those that pass.
    passed : Which these are.
    brought : Irradiance that each brings if it stands for its whole box of slopes and
        the scene is white; 0 for those that do not pass.
    """
    lower, sides = where.boxes(sensor_mm)
    slope = backward.middle_slope(sensor_mm) + lower + sides * drawn
    rays, clearance = backward.rays_into_scene(sensor_mm, slope, wavelength_nm)
    passed = clearance >= 0
    cosine_square = 1.0 / (1.0 + (slope**2).sum(axis=1))
    brought = passed * cosine_square**2 * np.prod(sides, axis=1)
    return rays.some(passed), np.flatnonzero(passed), brought

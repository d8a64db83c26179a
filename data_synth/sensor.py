"""From irradiance to a picture file's samples: electrons, noise, codes, colour mosaic.

The sensor fills at a value of 1. Shot noise is Poisson in electrons, read noise is
Gaussian; the black level is subtracted, so that dark samples scatter about zero.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import convolve

MOSAIC = "rggb"
"""Colours of the top left photosites of a sensor with a mosaic, row by row."""


@dataclass(frozen=True)
class Sensor:
    """What the camera adds to the light.

    Attributes
    ----------
    full_well_e : Electrons at a value of 1, where a sample saturates.
    read_noise_e : Standard deviation, electrons.
    adc_bits : Steps between 0 and 1 are 2^bits - 1; None keeps the continuum.
    bayer : Sample one colour a pixel (RGGB) and interpolate the others bilinearly.
    """

    full_well_e: float = 60000.0
    read_noise_e: float = 3.0
    adc_bits: int | None = 12
    bayer: bool = False


def digitise(
    irradiance: Float[np.ndarray, "height width 3"], sensor: Sensor, seed: int
) -> Float[np.ndarray, "height width 3"]:
    """Scene-linear samples of one exposure; the same seed gives the same noise."""
    rng = np.random.default_rng(seed)
    electrons = rng.poisson(irradiance * sensor.full_well_e).astype(float)
    electrons += rng.normal(scale=sensor.read_noise_e, size=electrons.shape)
    samples = np.minimum(electrons / sensor.full_well_e, 1.0)
    if sensor.adc_bits is not None:
        steps = 2**sensor.adc_bits - 1
        samples = np.round(samples * steps) / steps
    return demosaiced(samples) if sensor.bayer else samples


def demosaiced(
    samples: Float[np.ndarray, "height width 3"],
) -> Float[np.ndarray, "height width 3"]:
    """Keep the samples of an RGGB mosaic and fill the gaps bilinearly."""
    height, width, _ = samples.shape
    masks = np.zeros((3, height, width))
    masks[0, 0::2, 0::2] = 1
    masks[1, 0::2, 1::2] = masks[1, 1::2, 0::2] = 1
    masks[2, 1::2, 1::2] = 1
    kernel = np.array([[1.0, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4
    filled = [
        convolve(samples[..., k] * mask, kernel, mode="mirror")
        / convolve(mask, kernel, mode="mirror")
        for k, mask in enumerate(masks)
    ]
    kept = [
        np.where(mask > 0, samples[..., k], filled[k]) for k, mask in enumerate(masks)
    ]
    return np.stack(kept, -1)


def srgb_codes(
    linear: Float[np.ndarray, "height width 3"],
) -> Float[np.ndarray, "height width 3"]:
    """8-bit codes of the sRGB transfer curve (IEC 61966-2-1), rounded, as floats."""
    clipped = np.clip(linear, 0.0, 1.0)
    curved = np.where(
        clipped <= 0.0031308,
        12.92 * clipped,
        1.055 * clipped ** (1 / 2.4) - 0.055,
    )
    return np.round(curved * 255)

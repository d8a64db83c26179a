"""The camera behind the lens: its frame, its colour channels, its sensor.

The sensor fills at a value of 1. Shot noise is Poisson in electrons, read noise is
Gaussian; the black level is subtracted, so that dark samples scatter about zero.

Sensor millimetres are upright: origin at the centre, x right, y down.

A colour channel is a band of wavelengths: a Gaussian in wavelength, replaced
by a Gauss-Hermite rule: three nodes integrate polynomials up to degree five of the
wavelength exactly, which is enough for a spot that drifts smoothly with colour.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.ndimage import convolve


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


Channel = Literal["r", "g", "b"]
CHANNELS: tuple[Channel, ...] = ("r", "g", "b")
CENTRES_NM = {"r": 610.0, "g": 540.0, "b": 460.0}
SIGMA_NM = {"r": 22.0, "g": 25.0, "b": 20.0}


@dataclass(frozen=True)
class Band:
    """One channel: wavelengths and the share of the light at each (sums to 1)."""

    channel: str
    wavelengths_nm: tuple[float, ...]
    weights: tuple[float, ...]


def camera_bands(nodes: int = 3) -> tuple[Band, ...]:
    """Red, green and blue with this many wavelengths each."""
    offsets, weights = np.polynomial.hermite_e.hermegauss(nodes)
    shares = tuple(float(value) for value in weights / weights.sum())
    return tuple(
        Band(
            channel,
            tuple(float(CENTRES_NM[channel] + SIGMA_NM[channel] * o) for o in offsets),
            shares,
        )
        for channel in CHANNELS
    )


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

"""Colour channels as bands of wavelengths.

Each band is a Gaussian in wavelength, replaced by a Gauss-Hermite rule: three nodes
integrate polynomials up to degree five of the wavelength exactly, which is enough for a
spot that drifts smoothly with colour.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

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

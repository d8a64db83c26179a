"""Wide halos: light spread by a sum of Gaussians, each an octave wider than the last.

Gaussians of widths sigma 2^m and shares w_m stand for glare: equal shares fall off as
1/r^2, shares that halve with each octave as 1/r^3, between the narrowest and the widest
(the glare of eyes and lenses lies between the two). The shares sum to 1, so that
light is moved and not made. The size of a halo is its half-light radius, within which
half of its light lies.

Each Gaussian is put on at a size of the picture where it is a few pixels wide.

Reference: G. Spencer et al., SIGGRAPH 1995, on the glare of eye and lens.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from lensfit.render.look.pyramid import (
    Picture,
    doubled,
    gaussian,
    halved,
    left_of,
    level_of,
    padded,
)

Plane = Float32[np.ndarray, "height width 1"]
_STEPS = 60


@dataclass(frozen=True)
class Halo:
    """A kernel by the relative shares of its octaves, the narrowest first."""

    octaves: tuple[float, ...]

    @property
    def shares(self) -> tuple[float, ...]:
        """They sum to 1."""
        return tuple(w / sum(self.octaves) for w in self.octaves)

    def within(self, radius: float) -> float:
        """Share of the light within a radius, in units of the narrowest Gaussian."""
        each = enumerate(self.shares)
        return sum(w * -math.expm1(-0.5 * (radius / 2**m) ** 2) for m, w in each)

    @property
    def half_light_radius(self) -> float:
        """Within which half of the light lies, in the same units."""
        low, high = 0.0, 2.0 * 2 ** len(self.octaves)
        for _ in range(_STEPS):
            middle = (low + high) / 2
            low, high = (middle, high) if self.within(middle) < 0.5 else (low, middle)
        return low


def haloed(
    light: Picture, halo: Halo, half_light_px: float, least_px: float
) -> Picture:
    """Light spread into a halo.

    Parameters
    ----------
    half_light_px : Size of the halo.
    least_px : From `pyramid.least_sigma_px`.
    """
    narrowest = half_light_px / halo.half_light_radius
    sigmas = [narrowest * 2**m for m in range(len(halo.octaves))]
    level = level_of(sigmas[0], least_px, light.shape)
    small = halved(padded(light, level), level)
    spread = octaves_spread(small, level, sigmas, halo.shares, least_px)
    return doubled(spread, level)[: light.shape[0], : light.shape[1]]


def octaves_spread(
    small: Picture,
    level: int,
    sigmas_px: Sequence[float],
    shares: Sequence[float | Plane],
    least_px: float,
) -> Picture:
    """Light of a halved picture, each share of it spread by a Gaussian of its own.

    Parameters
    ----------
    small : Light, halved `level` times.
    sigmas_px : Growing, in pixels of the whole picture; those that `level` has used up
        already are left as they are.
    shares : One for all, or of each pixel of `small`.

    Returns
    -------
    At the size of `small`.
    """
    total = np.zeros_like(small)
    chain, reached = small, level
    for sigma_px, share in zip(sigmas_px, shares, strict=True):
        own = max(level, level_of(sigma_px, least_px, _whole_shape(small, level)))
        if isinstance(share, np.ndarray):
            part = halved(padded(small * share, own - level), own - level)
        else:
            chain = halved(padded(chain, own - reached), own - reached)
            part, reached = chain * np.float32(share), own
        spread = doubled(gaussian(part, left_of(sigma_px, own)), own - level)
        total += spread[: small.shape[0], : small.shape[1]]
    return total


def dealt(square: Plane, count: int) -> list[Plane]:
    """Sizes dealt to octaves so that each keeps its mean square.

    Parameters
    ----------
    square : Square of a size over the smallest one, 1 or more.
    count : Of the octaves; larger sizes than the last one's are taken as that.

    Returns
    -------
    Shares of the octaves 1, 2, 4, ...; they sum to 1.
    """
    square = np.clip(square, 1, 4.0 ** (count - 1)).astype(np.float32)
    shares = []
    for n in range(count):
        here = np.float32(4.0**n)
        rising = np.clip((square - here / 4) / (here * 3 / 4), 0, 1)
        falling = np.clip((4 * here - square) / (3 * here), 0, 1)
        shares.append(np.where(square <= here, rising if n else 1.0, falling))
    return [share.astype(np.float32) for share in shares]


def _whole_shape(small: Picture, level: int) -> tuple[int, int]:
    return small.shape[0] << level, small.shape[1] << level

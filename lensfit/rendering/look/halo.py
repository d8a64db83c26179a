"""Wide halos: light spread by a sum of Gaussians, each an octave wider than the last.

Gaussians of widths sigma 2^m and shares w_m stand for glare: equal shares fall off as
1/r^2, shares that halve with each octave as 1/r^3, between the narrowest and the widest
(the glare of eyes and lenses lies between the two). The shares sum to 1, so that
light is moved and not made. The size of a halo is its half-light radius, within which
half of its light lies.

Each Gaussian is put on at a size of the picture where it is a few pixels wide. What
leaves the picture comes back, as from a mirror image beside it: so as much light comes
in over a border as leaves, and the sum is kept. A constant stays constant, but for
what halving does beside borders that do not divide: .04 % of it at tolerance .001.

Reference: G. Spencer et al., SIGGRAPH 1995, on the glare of eye and lens.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit.rendering.look.pyramid import (
    Picture,
    doubled,
    gaussian,
    halved,
    left_of,
    level_of,
    padded,
    reach_of,
)

Plane = Float32[np.ndarray, "height width 1"]
_STEPS = 60
_EVEN = 1.5
"""Between mirrors, a Gaussian this many times as wide as the picture is even."""


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
    whole = small.shape[0] << level, small.shape[1] << level
    sigmas_px = [min(sigma_px, _EVEN * max(whole)) for sigma_px in sigmas_px]
    steps = [
        max(level_of(sigma_px, least_px, whole) - level, 0) for sigma_px in sigmas_px
    ]
    total, chain, taken = np.zeros_like(small), None, 0
    for sigma_px, share, more in zip(sigmas_px, shares, steps, strict=True):
        if isinstance(share, np.ndarray):
            rim = 2 << more
            part = halved(_in_the_dark(small * share, rim), more)
        else:
            rim = 2 << max(steps)
            if chain is None:
                chain = _in_the_dark(small, rim)
            chain, taken = halved(chain, more - taken), more
            part = chain * np.float32(share)
        sigma = left_of(sigma_px, level + more)
        reach = reach_of(sigma)
        spread = gaussian(_bordered(part, (reach, reach, reach, reach)), sigma)
        _fold(total, doubled(spread, more), rim + (reach << more))
    return total


def _in_the_dark(picture: Picture, rim: int) -> Picture:
    """The picture with a dark rim, which halves without rest as often as the rim."""
    below, right = (-side % rim for side in picture.shape[:2])
    return _bordered(picture, (rim, rim + below, rim, rim + right))


def _bordered(picture: Picture, widths: tuple[int, int, int, int]) -> Picture:
    made = cv2.copyMakeBorder(picture, *widths, cv2.BORDER_CONSTANT)
    return made.reshape(*made.shape[:2], picture.shape[2])


def _fold(total: Picture, spread: Picture, rim: int) -> None:
    """Add light that was spread around a picture too; what left it comes back over the
    same border, as from a mirror image."""
    height, width = total.shape[:2]
    band = np.zeros((height, *spread.shape[1:]), np.float32)
    for rows, own in _mirrors(spread.shape[0], height, rim):
        band[own] += spread[rows]
    for columns, own in _mirrors(spread.shape[1], width, rim):
        total[:, own] += band[:, columns]


def _mirrors(length: int, side: int, rim: int) -> list[tuple[slice, slice]]:
    """Parts of an axis, each as long as the picture's side or less, every other one
    backwards; and the part of the picture that each falls on."""
    found = []
    for n in range(-rim // side, -(-(length - rim) // side)):
        start = rim + n * side
        first, last = max(start, 0), min(start + side, length)
        if n % 2:
            before = first - 1 if first else None
            own = slice(start + side - last, start + side - first)
            found.append((slice(last - 1, before, -1), own))
        else:
            found.append((slice(first, last), slice(first - start, last - start)))
    return found


def octave_shares(square: Plane, count: int) -> list[Plane]:
    """Sizes divided among octaves so that each keeps its mean square.

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

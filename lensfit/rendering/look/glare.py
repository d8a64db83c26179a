"""Glare, a share of the light spread into a halo: pro-mist, diffusion and bloom.

The sum over the picture is kept in every channel.

Pro-mist, a filter whose specks scatter a share of all light into a wide halo: there is
no threshold; highlights glow, and the black level lifts by the share of the mean of the
surroundings, up to the width of the frame. The halo falls off as 1/r^2 over six
octaves. Diffusion, a net or soft-focus filter, softens detail around a sharp core: the
halo has three octaves, small enough to melt skin and edges; the rest stays where it
was, so that the picture remains sharp underneath. Both filters are in front of the
lens. Here they act after it, on the blurred and distorted picture: the halo is neither
distorted nor dimmed towards the corners, which is barely visible of a smooth halo.

Bloom is a glow around highlights that widens with defocus: a share of the light above
a threshold, whose halo falls off as 1/r^3. The halo's half-light radius b grows with
the circle of confusion of the light,

    b^2 = size^2 + (growth r)^2,

r the circle's radius; without depth r is 0. Sizes between two octaves are divided
between both, so that b is kept as a mean square. A light's own distance is known where
it stands in the plate, but its disc lies over pixels of other distances. So highlights,
and highlights times the radius of their discs, are each spread by a Gaussian as wide as
the disc, and divided (`blur_of_light`):

    r = sum of (light radius) spread / sum of light spread.

This only scales the bloom, so it is computed at a small size.

A halo is a sum of Gaussians, each an octave wider than the last. Widths sigma 2^m and
shares w_m stand for glare: equal shares fall off as
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
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32

from lensfit.rendering.circle import Circle
from lensfit.rendering.look.light import (
    Picture,
    all_light,
    brightness_above,
    doubled_picture,
    gaussian,
    halved_picture,
    left_of,
    level_of,
    light_above,
    padded_picture,
    picture_at_level,
    picture_with_halo,
    reach_of,
)

Plane = Float32[np.ndarray, "height width"]
_Sizes = Float32[np.ndarray, "height width 1"]
_STEPS = 60
_EVEN = 1.5
"""Between mirrors, a Gaussian this many times as wide as the picture is even."""
_MOST_OCTAVES = 8
LEVEL = 2
"""How often the blur of light is halved."""
_LEAST_PX = 1.0
_DISC_SIGMA = 0.5
"""Standard deviation of a disc, along one direction, over its radius."""
_MOST_DISC_OCTAVES = 10


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


def light_with_halo(
    light: Picture, halo: Halo, half_light_px: float, least_px: float
) -> Picture:
    """Light spread into a halo.

    Parameters
    ----------
    half_light_px : Size of the halo.
    least_px : From `light.least_sigma_px`.
    """
    narrowest = half_light_px / halo.half_light_radius
    sigmas = [narrowest * 2**m for m in range(len(halo.octaves))]
    level = level_of(sigmas[0], least_px, light.shape)
    small = halved_picture(padded_picture(light, level), level)
    spread = octaves_spread(small, level, sigmas, halo.shares, least_px)
    return doubled_picture(spread, level)[: light.shape[0], : light.shape[1]]


def octaves_spread(
    small: Picture,
    level: int,
    sigmas_px: Sequence[float],
    shares: Sequence[float | _Sizes],
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
            part = halved_picture(_with_dark_rim(small * share, rim), more)
        else:
            rim = 2 << max(steps)
            if chain is None:
                chain = _with_dark_rim(small, rim)
            chain, taken = halved_picture(chain, more - taken), more
            part = chain * np.float32(share)
        sigma = left_of(sigma_px, level + more)
        reach = reach_of(sigma)
        spread = gaussian(_with_border(part, (reach, reach, reach, reach)), sigma)
        _fold(total, doubled_picture(spread, more), rim + (reach << more))
    return total


def _with_dark_rim(picture: Picture, rim: int) -> Picture:
    """The picture with a dark rim, which halves without rest as often as the rim."""
    below, right = (-side % rim for side in picture.shape[:2])
    return _with_border(picture, (rim, rim + below, rim, rim + right))


def _with_border(picture: Picture, widths: tuple[int, int, int, int]) -> Picture:
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


def octave_shares(square: _Sizes, count: int) -> list[_Sizes]:
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


PRO_MIST = Halo((1.0,) * 6)
DIFFUSION = Halo((1.0,) * 3)
BLOOM = Halo((1.0, 0.5, 0.25, 0.125))


def filtered_picture(
    colour: Picture, halo: Halo, share: float, half_light_px: float, least_px: float
) -> Picture:
    """A picture behind a filter that scatters all light alike.

    Parameters
    ----------
    halo : `PRO_MIST` or `DIFFUSION`.
    share : Of the light that is scattered, 0 to 1.
    half_light_px : Within which half of that lands.
    least_px : From `light.least_sigma_px`.
    """
    light = all_light(colour)
    scattered = light_with_halo(light, halo, half_light_px, least_px)
    return picture_with_halo(colour, light, scattered, share)


def picture_with_bloom(
    colour: Picture,
    threshold: float,
    share: float,
    half_light_px: float,
    least_px: float,
    halo_radius_px: Plane | None = None,
) -> Picture:
    """A picture with its highlights in bloom.

    Parameters
    ----------
    threshold : Scene-linear; see `light`.
    share : Of the light above it that blooms, 0 to 1.
    half_light_px : Within which half of it lands.
    least_px : From `light.least_sigma_px`.
    halo_radius_px : How much farther it spreads, as the half-light radius that adds to
        the other in quadrature; over the picture at any size. Nothing if None.
    """
    light = light_above(colour, threshold)
    if light.max() <= 0:
        return colour
    if halo_radius_px is None or halo_radius_px.max() <= 0:
        halo = light_with_halo(light, BLOOM, half_light_px, least_px)
    else:
        halo = _growing(light, half_light_px, least_px, halo_radius_px)
    return picture_with_halo(colour, light, halo, share)


def _growing(
    light: Picture, half_light_px: float, least_px: float, more_px: Plane
) -> Picture:
    """`light_with_halo`, with a size for each pixel."""
    narrowest = half_light_px / BLOOM.half_light_radius
    level = level_of(narrowest, least_px, light.shape)
    small = halved_picture(padded_picture(light, level), level)
    more = picture_at_level(more_px[..., None], LEVEL, level)
    more = more[: small.shape[0], : small.shape[1]]
    square = 1 + (more / np.float32(half_light_px)) ** 2
    widest = math.ceil(math.log2(float(square.max())) / 2)
    sizes = octave_shares(square, 1 + min(widest, _MOST_OCTAVES))
    # The octave m of the halo of size n is octave m + n of all.
    shares = [
        sum(
            (
                np.float32(BLOOM.shares[m - n]) * size
                for n, size in enumerate(sizes)
                if 0 <= m - n < len(BLOOM.shares)
            ),
            np.zeros_like(square),
        )
        for m in range(len(sizes) + len(BLOOM.shares) - 1)
    ]
    sigmas = [narrowest * 2**m for m in range(len(shares))]
    spread = octaves_spread(small, level, sigmas, shares, least_px)
    return doubled_picture(spread, level)[: light.shape[0], : light.shape[1]]


class SharpLayer(NamedTuple):
    """What stands in the plate, before the lens blurs it.

    Attributes
    ----------
    colour : Premultiplied, dimmed by what stands before it.
    radius_px : Signed radius of its blur; None where nothing is known of depth.
    """

    colour: Picture
    radius_px: Plane | None


def sharp_layers(
    rgba: Sequence[Float32[np.ndarray, "height width 4"]],
    depth_mm: Sequence[Float32[np.ndarray, "height width"]],
    circle: Circle,
) -> list[SharpLayer]:
    """Layers front to back, each dimmed by what stands before it.

    Parameters
    ----------
    rgba : Premultiplied, front to back.
    depth_mm : Of each, from the entrance pupil.
    circle : Radius of blur of a distance.
    """
    found, through = [], None
    for colour, depth in zip(rgba, depth_mm, strict=True):
        seen = colour[..., :3]
        seen = seen if through is None else seen * through
        found.append(SharpLayer(seen, circle.radius_px(depth)))
        left = np.clip(1 - colour[..., 3:], 0, 1)
        through = left if through is None else through * left
    return found


def blur_of_light(layers: Sequence[SharpLayer], threshold: float) -> Plane:
    """Radius of the discs that highlights arrive in, 0 where there are none.

    Parameters
    ----------
    threshold : As `light_above`.

    Returns
    -------
    In pixels of the whole picture, at a quarter of its size (and what `padded_picture`
    adds).
    """
    parts = []
    for layer in layers:
        if layer.radius_px is None:
            continue
        light = brightness_above(layer.colour, threshold)
        both = np.stack([light, light * np.abs(layer.radius_px)], -1)
        parts.append(halved_picture(padded_picture(both, LEVEL), LEVEL))
    if not parts:
        height, width = layers[0].colour.shape[:2]
        return np.zeros((-(-height >> LEVEL), -(-width >> LEVEL)), np.float32)
    spread = sum((_as_discs(part) for part in parts), np.zeros_like(parts[0]))
    return spread[..., 1] / np.maximum(spread[..., 0], np.finfo(np.float32).tiny)


def _as_discs(part: Picture) -> Picture:
    """Light and its radius, spread as far as that radius."""
    light = np.maximum(part[..., :1], np.finfo(np.float32).tiny)
    radius_px = np.maximum(part[..., 1:], 0) / light
    smallest_px = float(2**LEVEL)
    square = 1 + (radius_px * np.float32(_DISC_SIGMA / smallest_px)) ** 2
    octaves = int(np.ceil(np.log2(float(square.max())) / 2)) + 1
    shares = octave_shares(square, min(octaves, _MOST_DISC_OCTAVES))
    # The smallest is no blur: sizes count in quadrature from one small pixel.
    sigmas = [smallest_px * (4.0**n - 1) ** 0.5 for n in range(len(shares))]
    sigmas = [max(sigma, 1e-3) for sigma in sigmas]
    return octaves_spread(part, LEVEL, sigmas, shares, _LEAST_PX)

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

r the circle's radius (`blur_of_light`); without depth r is 0. Sizes between two octaves
are divided between both, so that b is kept as a mean square.
"""

import math

import numpy as np
from jaxtyping import Float32

from lensfit.rendering.look.blur_of_light import LEVEL
from lensfit.rendering.look.halo import Halo, haloed, octave_shares, octaves_spread
from lensfit.rendering.look.light import all_light, light_above, picture_with_halo
from lensfit.rendering.look.pyramid import (
    Picture,
    doubled,
    halved,
    level_of,
    padded,
    relevelled,
)

PRO_MIST = Halo((1.0,) * 6)
DIFFUSION = Halo((1.0,) * 3)
BLOOM = Halo((1.0, 0.5, 0.25, 0.125))
_MOST_OCTAVES = 8

Plane = Float32[np.ndarray, "height width"]


def filtered_picture(
    colour: Picture, halo: Halo, share: float, half_light_px: float, least_px: float
) -> Picture:
    """A picture behind a filter that scatters all light alike.

    Parameters
    ----------
    halo : `PRO_MIST` or `DIFFUSION`.
    share : Of the light that is scattered, 0 to 1.
    half_light_px : Within which half of that lands.
    least_px : From `pyramid.least_sigma_px`.
    """
    light = all_light(colour)
    scattered = haloed(light, halo, half_light_px, least_px)
    return picture_with_halo(colour, light, scattered, share)


def bloomed(
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
    least_px : From `pyramid.least_sigma_px`.
    halo_radius_px : How much farther it spreads, as the half-light radius that adds to
        the other in quadrature; over the picture at any size. Nothing if None.
    """
    light = light_above(colour, threshold)
    if light.max() <= 0:
        return colour
    if halo_radius_px is None or halo_radius_px.max() <= 0:
        halo = haloed(light, BLOOM, half_light_px, least_px)
    else:
        halo = _growing(light, half_light_px, least_px, halo_radius_px)
    return picture_with_halo(colour, light, halo, share)


def _growing(
    light: Picture, half_light_px: float, least_px: float, more_px: Plane
) -> Picture:
    """`haloed`, with a size for each pixel."""
    narrowest = half_light_px / BLOOM.half_light_radius
    level = level_of(narrowest, least_px, light.shape)
    small = halved(padded(light, level), level)
    more = relevelled(more_px[..., None], LEVEL, level)
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
    return doubled(spread, level)[: light.shape[0], : light.shape[1]]

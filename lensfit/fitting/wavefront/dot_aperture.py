"""The dot aperture in the image: every ray starts from its own point of it.

A dot is a disc on the chart, an ellipse on the sensor, and its image is the blur of a
point convolved with that ellipse. Where blur is no wider than the dot aperture, the
edge of the aperture is visible: a Gaussian in its place misses a tenth of the image,
and other aberrations compensate for it. So the points from which rays start are spread
over the aperture as evenly as the points where they cross the pupil, and independently
of these: no ray is added. In a wide blur rays lie too far apart for that, and there the
edge is not visible. So the wider the blur, the smaller the ellipse that the points
fill; each ray is a Gaussian that supplies the missing variance. The second moments
along x and y are always those of the dot aperture.

Reference: H. Niederreiter, Random Number Generation and Quasi-Monte Carlo Methods
(1992), chapter 3, on sequences of multiples, as the points are.
"""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_AS_WIDE, _STEEP = 3.5, 4
"""Radius of the blur over that of the dot aperture at which the points carry half the
variance, and how steeply that share falls: between what is best for an even disc (2.5)
and for the bright core of a caustic (8), against images of very many rays, for dot
apertures of .45 to 1.6 pixels and images of 768 or 1536 rays. With a larger radius the
rays of a wide blur leave gaps, which appeared in the lateral colour of fits; with a
smaller one edges are soft.
"""
_MULTIPLES = 0.18694387586474648, 0.448665771747608
"""Of radius and azimuth, with which images of 768 and 1536 rays were nearest to those
of very many, of sixty pairs drawn by chance that fill the disc well by themselves: half
of the error of the plastic number's powers, which with the angle of the pupil's spiral
leave gaps."""


class DotAperture(NamedTuple):
    """Dot apertures of all dots: an ellipse that points sample, and a Gaussian.

    Attributes
    ----------
    sampled_ellipse_mm : Matrix from the unit disc to the ellipse on the
        sensor that the points fill.
    variance_mm2 : Of the Gaussian with the remaining variance, along x and y.
    """

    sampled_ellipse_mm: Float[np.ndarray, "dots 2 2"]
    variance_mm2: Float[np.ndarray, "dots 2"]


def dot_aperture_of(
    dot_aperture_mm: Float[np.ndarray, "dots 2 2"],
    diameter_mm: Float[np.ndarray, " dots"],
) -> DotAperture:
    """Both parts, chosen by the width of the blur.

    Parameters
    ----------
    dot_aperture_mm : From the unit disc to the image of the dot aperture.
    diameter_mm : Of the disc of the dot's second moment, as photographed.
    """
    aperture_radius_mm2 = np.sum(dot_aperture_mm**2, (-2, -1)) / 2
    blur_radius_mm2 = np.maximum(diameter_mm**2 / 4 - aperture_radius_mm2, 0.0)
    as_wide = np.sqrt(blur_radius_mm2 / aperture_radius_mm2)
    return _with_sampled_share(
        1 / (1 + (as_wide / _AS_WIDE) ** _STEEP), dot_aperture_mm
    )


def no_dot_aperture(dot_aperture_mm: Float[np.ndarray, "dots 2 2"]) -> DotAperture:
    """Zero in both parts: of broad dots, which are drawn in waves (`waves`).

    Parameters
    ----------
    dot_aperture_mm : As for `dot_aperture_of`.
    """
    return DotAperture(
        np.zeros_like(dot_aperture_mm), np.zeros(dot_aperture_mm.shape[:2])
    )


def gaussian_dot_aperture(
    dot_aperture_mm: Float[np.ndarray, "dots 2 2"],
) -> DotAperture:
    """A Gaussian alone, where edges cannot be resolved.

    Parameters
    ----------
    dot_aperture_mm : As for `dot_aperture_of`.
    """
    return _with_sampled_share(np.zeros(len(dot_aperture_mm)), dot_aperture_mm)


def _with_sampled_share(
    share: Float[np.ndarray, " dots"], dot_aperture_mm: Float[np.ndarray, "dots 2 2"]
) -> DotAperture:
    """With this share of the variance in the points."""
    moments_mm2 = np.sum(dot_aperture_mm**2, -1) / 4
    sampled_ellipse_mm = np.sqrt(share)[:, None, None] * dot_aperture_mm
    return DotAperture(sampled_ellipse_mm, (1 - share)[:, None] * moments_mm2)


def ray_origins_mm(
    sampled_ellipse_mm: Float[Array, "2 2"], count: int
) -> Float[Array, "count 2"]:
    """Points that rays start from, on the sensor, from the dot aperture's middle.

    Parameters
    ----------
    sampled_ellipse_mm : Of one dot.
    count : Of rays (static).
    """
    return (
        jnp.asarray(places_in_disc(count), sampled_ellipse_mm.dtype)
        @ sampled_ellipse_mm.T
    )


@cache
def places_in_disc(count: int) -> Float[np.ndarray, "count 2"]:
    """Points evenly over the unit disc, zero mean, in quasi-random order."""
    share, turn = np.outer(_MULTIPLES, np.arange(count) + 0.5) % 1.0
    angle = 2 * np.pi * turn
    places = np.sqrt(share)[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    return places - places.mean(0)

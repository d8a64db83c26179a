"""The hole of a dot, as its image has it: every ray leaves from a place of its own.

A dot is a disc on the chart, an ellipse on the sensor, and its image is the blur of a
point smeared over that. Where blur is no wider than the hole, the hole's rim shows: a
Gaussian in its place misses a tenth of the image, and other aberrations make up for it.
So the places that rays leave the hole from are spread over it as evenly as those where
they pass the opening, and independently of these: no ray is added. In a wide blur rays
lie too far apart for that, and there the rim does not show: so the wider the blur, the
smaller the ellipse that places fill, and each ray is a Gaussian that makes up for it.
The second moments along x and y are always those of the hole.

Reference: H. Niederreiter, Random Number Generation and Quasi-Monte Carlo Methods
(1992), chapter 3, on sequences of multiples, as the places are.
"""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_AS_WIDE, _STEEP = 3.5, 4
"""Radius of the blur over that of the hole at which places have half the variance, and
how fast that goes: between what is best for an even disc (2.5) and for the bright core
of a caustic (8), against images of very many rays, for holes of .45 to 1.6 pixels and
images of 768 or 1536 rays. More, and rays of a wide blur leave gaps, which showed in
the lateral colour of fits; less, and rims are soft.
"""
_MULTIPLES = 0.0842482705314127, 0.8975713809549175
"""Of radius and azimuth, with which images of 384 to 3072 rays were nearest to those of
very many, of 1200 pairs: a sixth of the error of the plastic number's powers, which
with the golden angle of the opening leave gaps."""


class Hole(NamedTuple):
    """Of every dot, in two parts.

    Attributes
    ----------
    filled_mm : From the unit disc to the ellipse on the sensor that places fill.
    variance_mm2 : Of the Gaussian that makes up for the rest, along x and y.
    """

    filled_mm: Float[np.ndarray, "dots 2 2"]
    variance_mm2: Float[np.ndarray, "dots 2"]


def hole_of(
    hole_mm: Float[np.ndarray, "dots 2 2"], diameter_mm: Float[np.ndarray, " dots"]
) -> Hole:
    """The parts that suit the blur.

    Parameters
    ----------
    hole_mm : From the unit disc to the image of the hole.
    diameter_mm : Of the disc of the dot's second moment, as photographed.
    """
    hole_radius_mm2 = np.sum(hole_mm**2, (-2, -1)) / 2
    blur_radius_mm2 = np.maximum(diameter_mm**2 / 4 - hole_radius_mm2, 0.0)
    as_wide = np.sqrt(blur_radius_mm2 / hole_radius_mm2)
    return _of_share(1 / (1 + (as_wide / _AS_WIDE) ** _STEEP), hole_mm)


def no_hole(hole_mm: Float[np.ndarray, "dots 2 2"]) -> Hole:
    """Of a broad dot, which is drawn otherwise (`waves`).

    Parameters
    ----------
    hole_mm : As for `hole_of`.
    """
    return Hole(np.zeros_like(hole_mm), np.zeros(hole_mm.shape[:2]))


def soft_hole(hole_mm: Float[np.ndarray, "dots 2 2"]) -> Hole:
    """A Gaussian alone, for who cannot see rims.

    Parameters
    ----------
    hole_mm : As for `hole_of`.
    """
    return _of_share(np.zeros(len(hole_mm)), hole_mm)


def _of_share(
    share: Float[np.ndarray, " dots"], hole_mm: Float[np.ndarray, "dots 2 2"]
) -> Hole:
    """With so much of the variance in the places."""
    moments_mm2 = np.sum(hole_mm**2, -1) / 4
    filled_mm = np.sqrt(share)[:, None, None] * hole_mm
    return Hole(filled_mm, (1 - share)[:, None] * moments_mm2)


def left_from_mm(filled_mm: Float[Array, "2 2"], count: int) -> Float[Array, "count 2"]:
    """Where on the sensor the places lie that rays leave from, from the hole's middle.

    Parameters
    ----------
    filled_mm : Of one dot.
    count : Of rays (static).
    """
    return jnp.asarray(places_in_disc(count), filled_mm.dtype) @ filled_mm.T


@cache
def places_in_disc(count: int) -> Float[np.ndarray, "count 2"]:
    """Evenly over the unit disc, about their middle; in an order of their own."""
    share, turn = np.outer(_MULTIPLES, np.arange(count) + 0.5) % 1.0
    angle = 2 * np.pi * turn
    places = np.sqrt(share)[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    return places - places.mean(0)

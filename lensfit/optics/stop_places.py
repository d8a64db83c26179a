"""The stop of one lens: places in it, its edge, and how much light each lets through.

Places count from the middle of the stop in its own radii, x right and y down; what they
and the blades are is said in `lensfit.optics.pupil`.

What places let through gives a blurred light its inside. Without it the opening is
even. With the ring brightness b and the squared share x of the way from the middle of
the stop to its edge, blades included,

    (1 + b) x^b  for b > 0,      (1 + |b|) (1 - x)^|b|  for b < 0,

whose mean over a round opening is 1. A filter is a picture of the stop, for each
colour; its side is the diameter of the stop as set, so that it grows with the circle of
confusion. A ray that moves right as it travels lands right of its chief ray once it has
passed its focus: with x right and y down in the stop, as everywhere, the picture stands
upright in the image of a point beyond the focus distance and is turned by half a turn
before it.

The picture is kept at several sizes, each half the next, and read at one that rays can
show: about one ray for each of its pixels.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.optics.pupil import (
    SHARPNESS,
    Pupil,
    blade_apothem,
    blade_sectors,
    middle_of_stop,
    stretch_matrix,
)


def rays_at_stop(
    place: Float[Array, "rays 2"],
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
) -> Float[Array, "rays 2"]:
    """u of rays at places of the stop: the inverse of `pupil.places_in_stop`."""
    middle = middle_of_stop(h, stop_radius, pupil)
    return (middle[None] + stop_radius * place) @ stretch_matrix(h, pupil)


class StopArcs(NamedTuple):
    """The edge of the stop: one arc for each blade.

    An arc of curvature k at distance d, with normal n, lets a place s through where
    k |s|^2 / 2 + (1 - k d) n.s <= d - k d^2 / 2.

    Attributes
    ----------
    azimuth_rad : Of the normals, from x towards y.
    distance, curvature : d and k, the same for all.
    """

    azimuth_rad: Float[np.ndarray, " arcs"]
    distance: float
    curvature: float

    @property
    def reach(self) -> float:
        """Radius of the smallest disc about the middle that holds the opening."""
        d, k, arcs = self.distance, self.curvature, len(self.azimuth_rad)
        b = (1 - k * d) * math.cos(math.pi / arcs) if arcs > 1 else 0.0
        c = d - k * d * d / 2
        return 2 * c / (b + math.sqrt(b * b + 2 * k * c))

    def passes(self, places: Float[np.ndarray, "rays 2"]) -> np.ndarray:
        """Whether the blades let places through."""
        d, k = self.distance, self.curvature
        normal = np.stack([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)])
        bent = k / 2 * np.sum(places**2, -1, keepdims=True)
        return (bent + (1 - k * d) * (places @ normal) <= d - k * d * d / 2).all(-1)


def stop_arcs(pupil: Pupil) -> StopArcs:
    """The blades as `pupil.places_in_stop` has them, with sharp corners."""
    curvature, used, sector = (np.asarray(part) for part in blade_sectors(pupil))
    first = float(pupil.blade_rotation_rad) + float(sector) / 2
    distance = float(blade_apothem(pupil, SHARPNESS))
    azimuth = first + float(sector) * np.arange(int(used.sum()))
    return StopArcs(azimuth, distance, float(curvature) / distance)


SIZES_PX = (32, 64, 128, 256, 512)
_FINER = 1.5
"""Pixels of the filter over what as many rays would have each to itself."""


class Transmission(eqx.Module):
    """Of the stop of one lens.

    Attributes
    ----------
    ring_brightness : b.
    rotation_rad : Of the filter, from x towards y.
    filters : For r, g and b, row 0 on top, coarse to fine; () for none.
    """

    ring_brightness: Float[Array, ""]
    rotation_rad: Float[Array, ""]
    filters: tuple[Float[Array, "3 side side"], ...] = ()


def transmitted_light(
    place: Float[Array, "rays 2"],
    edge: Float[Array, " rays"],
    channel: Int[Array, ""],
    rays: Float[Array, ""],
    transmission: Transmission,
) -> Float[Array, " rays"]:
    """Share of the light of each ray, but for a constant.

    Parameters
    ----------
    place : From the middle of the stop, in its radii.
    edge : How far away in that direction the blades are.
    channel : 0, 1 or 2 for red, green or blue.
    rays : How many there are altogether.
    """
    share = jnp.clip(jnp.sum(place * place, -1) / (edge * edge), 0.0, 1.0)
    found = _ring(share, transmission.ring_brightness)
    if not transmission.filters:
        return found
    cos, sin = (f(transmission.rotation_rad) for f in (jnp.cos, jnp.sin))
    # A row times the matrix: the picture turned one way is read turned the other.
    upright = place @ jnp.stack([jnp.stack([cos, -sin]), jnp.stack([sin, cos])])
    each = [_read(of[channel], upright) for of in transmission.filters]
    side = _FINER * jnp.sqrt(4 / jnp.pi * rays)
    sides = np.array([float(of.shape[-1]) for of in transmission.filters])
    size = jnp.clip(jnp.sum(sides <= side) - 1, 0, len(each) - 1)
    return found * jnp.stack(each)[size]


def _ring(share: Array, b: Array) -> Array:
    brighter = jnp.where(b < 0, 1 - share, share)
    power = jnp.abs(b)
    return jnp.where(power > 0, (1 + power) * brighter**power, 1.0)


def _read(picture: Array, place: Array) -> Array:
    """Bilinearly; nothing beside the picture."""
    side = picture.shape[-1]
    padded = jnp.pad(picture, 1)
    at = jnp.clip((place + 1) * (side / 2) + 0.5, 0.0, side + 1.0)
    low = jnp.clip(jnp.floor(at), 0.0, float(side))
    x, y = (at - low).T
    column, row = low.astype(int).T
    upper = padded[row, column] * (1 - x) + padded[row, column + 1] * x
    lower = padded[row + 1, column] * (1 - x) + padded[row + 1, column + 1] * x
    return upper * (1 - y) + lower * y

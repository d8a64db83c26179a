"""Rays that sample the opening of one field point: in a spiral, or on rings and spokes.

What the opening is, and u, is said in `lensfit.optics.pupil`. Every function takes one
field point; callers map it over many with `jax.vmap`.

Reference: H. Vogel, Mathematical Biosciences 44 (1979), the spiral of a constant angle;
Gauss's quadrature.
"""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lensfit.optics.pupil import (
    SHARPNESS,
    Pupil,
    edge_from_inside,
    opening_area,
    pupil_rays,
    stretch_matrix,
    stretched_area,
)

TURN = 3**-0.5
"""Part of a turn by which azimuths advance from ray to ray. Its multiples, and those of
three times it, are spread about evenly: rays may take three wavelengths in turn, and
each wavelength still fills the pupil by itself. (Every third ray of a spiral of golden
angles lies on one of seven arms.)"""
FEWEST_SPOKES = 97


class RayGroup(NamedTuple):
    """One of several groups that share out the rays of a spiral: few rays at a time, in
    a loop, make a sum over many.

    Attributes
    ----------
    index, count : Which group it is, and of how many; it has every `count`-th ray.
    """

    index: Int[Array, ""] | int
    count: Int[Array, ""] | int


ALL_RAYS = RayGroup(0, 1)


class Opening(eqx.Module):
    """The opening of one field point, as the rays of a spiral see it.

    Attributes
    ----------
    centre : Of the opening as the stop has it.
    edge : From there to the edge, on every spoke, in the order of the rays.
    density : Area that a ray of each spoke stands for, up to a factor.
    stretch : From there to u.
    area : As for `PupilNodes`.
    """

    centre: Float[Array, "2"]
    edge: Float[Array, "spokes 2"]
    density: Float[Array, " spokes"]
    stretch: Float[Array, "2 2"]
    area: Float[Array, ""]


class PupilNodes(eqx.Module):
    """Sample rays of one field point.

    Attributes
    ----------
    u : Direction cosines against the chief ray, in reference units.
    weight : Share of the light, sums to 1.
    area : Area of the opening in u; that of the reference aperture on axis is pi.
    """

    u: Float[Array, "nodes 2"]
    weight: Float[Array, " nodes"]
    area: Float[Array, ""]


def pupil_nodes(
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
    nodes: int,
    sharpness: float = SHARPNESS,
    turn_rad: Float[Array, ""] | float = 0.0,
) -> PupilNodes:
    """Rays that fill the opening evenly, in a spiral of a constant angle.

    The angle is nearly `TURN`: a ratio of whole numbers, so that rays lie on a few
    hundred spokes and the edge of the opening is asked for once on each: as even while
    spokes are no fewer than a sixteenth of the rays.

    Parameters
    ----------
    h : Field point in field radii.
    stop_radius : Of the stop as set, in radii of the reference stop.
    nodes : How many rays (static).
    turn_rad : Of the whole spiral.
    """
    fewest = max(nodes // 16, FEWEST_SPOKES)
    return nodes_in(
        opening_on_spokes(h, stop_radius, pupil, fewest, sharpness, turn_rad), nodes
    )


def opening_on_spokes(
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
    fewest: int = FEWEST_SPOKES,
    sharpness: float = SHARPNESS,
    turn_rad: Float[Array, ""] | float = 0.0,
) -> Opening:
    """The opening of one field point, its edge on at least so many spokes (static);
    other parameters as for `pupil_nodes`."""
    turned = jnp.asarray(_spokes(fewest), h.dtype) + turn_rad
    centre, outward, radius = edge_from_inside(turned, h, stop_radius, pupil, sharpness)
    return Opening(
        centre=centre,
        edge=radius[:, None] * outward,
        density=radius * radius,
        stretch=stretch_matrix(h, pupil),
        area=jnp.pi * jnp.mean(radius * radius) * stretched_area(h, pupil),
    )


def nodes_in(opening: Opening, nodes: int, group: RayGroup = ALL_RAYS) -> PupilNodes:
    """Rays of a group; those of all groups fill the opening in one spiral.

    Parameters
    ----------
    nodes : How many rays the group has (static).
    """
    number = group.index + group.count * np.arange(nodes)
    spoke = number % len(opening.density)
    rays = jnp.asarray(group.count * nodes, float)
    inside = (jnp.asarray(number, float) + 0.5) / rays
    reach = jnp.sqrt(inside).astype(opening.edge.dtype)
    s = opening.centre[None] + reach[:, None] * opening.edge[spoke]
    density = opening.density[spoke]
    return PupilNodes(
        u=s @ opening.stretch, weight=density / jnp.sum(density), area=opening.area
    )


def _spokes(fewest: int) -> np.ndarray:
    """Azimuths that follow each other by nearly `TURN`, evenly spread: its best
    approximations by whole numbers."""
    (step, last), following = (1, 2), (3, 5)
    for times in itertools.cycle((1, 2)):  # its continued fraction
        if last >= fewest:
            break
        before, (step, last) = (step, last), following
        following = times * step + before[0], times * last + before[1]
    return np.arange(last) * step % last * (2 * np.pi / last)


def polar_nodes(
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
    rings: int,
    spokes: int,
    sharpness: float = SHARPNESS,
) -> PupilNodes:
    """Rays on rings and spokes, exact for smooth functions such as moments.

    Gauss's rule along each spoke, the trapezoidal rule around. (On pixels the rings
    would show: `pupil_nodes` has none.)
    """
    square, weight = np.polynomial.legendre.leggauss(rings)
    azimuth = np.repeat(np.arange(spokes) * (2 * np.pi / spokes), rings)
    reach = np.tile(np.sqrt((square + 1) / 2), spokes)
    azimuth, reach = jnp.asarray(azimuth, h.dtype), jnp.asarray(reach, h.dtype)
    u, density = pupil_rays(h, stop_radius, pupil, azimuth, reach, sharpness)
    weight = density * jnp.asarray(np.tile(weight, spokes), h.dtype)
    return PupilNodes(
        u=u,
        weight=weight / jnp.sum(weight),
        area=opening_area(h, stop_radius, pupil, sharpness),
    )

"""The spot of one dot: rays through the opening, each with its weight and its width.

Rays fill the opening of the pupil evenly (`optics.pupil`), each standing for a cell of
equal area and carrying the light of that (`optics.etendue`). They are distributed over
the wavelengths in turn: half as many rays as if every point of the opening sent one of
each wavelength are as accurate. The image of a cell is stood for by a round Gaussian
(`pixels`) whose variance is proportional to

    A/M |dx/du|^2 / 2,

with A/M the area of a cell: it goes to 0 in focus and at a caustic without singularity,
and the spot's second moment converges like 1/M.

Every function takes one dot; callers map it over many with `jax.vmap`.

Reference: P. S. Heckbert, Fundamentals of Texture Mapping and Image Warping (1989), for
elliptical weighted averages; here the footprint's trace is enough.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.aberration import (
    Aberration,
    LocalWavefront,
    landing_and_jacobian_mm,
    local_wavefront,
)
from lensfit.optics.depth import ObjectShift
from lensfit.optics.etendue import light_density
from lensfit.optics.pupil_nodes import PupilNodes


class Landed(NamedTuple):
    """Rays where they land; `landed_rays` has them by wavelength.

    Attributes
    ----------
    at_mm : Landing points from the chief ray of the ray's own wavelength.
    slope_mm : d landing / d u.
    light : Carried per area of the opening, up to a factor.
    """

    at_mm: Float[Array, "*rays 2"]
    slope_mm: Float[Array, "*rays 2 2"]
    light: Float[Array, "*rays"]


class Spot(eqx.Module):
    """Rays on the sensor.

    Attributes
    ----------
    landing_mm : From where the green chief ray lands, x right, y down.
    weight : Share of the light, sums to 1.
    cell_mm2 : Area of each ray's cell times |dx/du|^2 / 2.
    """

    landing_mm: Float[Array, "rays 2"]
    weight: Float[Array, " rays"]
    cell_mm2: Float[Array, " rays"]


def landed_rays(
    u: Float[Array, "wavelengths points 2"],
    field_point_mm: Float[Array, "2"],
    aberration: Aberration,
    defocus_mm: Float[Array, ""],
    chromatic: Float[Array, " wavelengths"],
    depth: ObjectShift | None = None,
    cylinder_mm: Float[Array, "2 2"] | None = None,
) -> Landed:
    """Where the rays through points of the opening land.

    Parameters
    ----------
    u : Points of the opening, of each wavelength its own.
    field_point_mm : Where the green chief ray lands, from the principal point.
    defocus_mm : How far the sensor lies behind the sharp image.
    chromatic : Chromatic coordinates of the wavelengths (`optics.spectrum`).
    depth : Where the object is not at the distance that the aberrations hold for.
    cylinder_mm : Of an anamorphic lens (`optics.sections`).
    """
    local = jax.vmap(local_wavefront, (None, 0, None, None, None))(
        field_point_mm, chromatic, aberration, depth, cylinder_mm
    )

    def one(u: Array, of_wavelength: LocalWavefront) -> Landed:
        landed = landing_and_jacobian_mm(u, defocus_mm, of_wavelength)
        return Landed(*landed, light_density(u, defocus_mm, of_wavelength))

    return jax.vmap(jax.vmap(one, (0, None)))(u, local)


def split_by_wavelength(
    of_nodes: Float[Array, "nodes *shape"], wavelengths: int
) -> Float[Array, "wavelengths points *shape"]:
    """Nodes of the opening, in turn to one wavelength after the other.

    Parameters
    ----------
    of_nodes : Their number is a multiple of `wavelengths`.
    """
    shape = (-1, wavelengths, *of_nodes.shape[1:])
    return jnp.swapaxes(of_nodes.reshape(shape), 0, 1)


def spot_of(
    landed: Landed, nodes: PupilNodes, lateral_mm: Float[Array, "wavelengths 2"]
) -> Spot:
    """All rays of `landed_rays` together, one wavelength after the other.

    Parameters
    ----------
    nodes : Whose points, distributed over the wavelengths, they went through.
    lateral_mm : Displacement of each wavelength's chief ray against green's.
    """
    share = split_by_wavelength(nodes.weight, len(lateral_mm))
    light = share * landed.light
    cell = share * nodes.area * jnp.sum(landed.slope_mm**2, (-2, -1)) / 2
    return Spot(
        landing_mm=(landed.at_mm + lateral_mm[:, None]).reshape(-1, 2),
        weight=(light / jnp.sum(light)).reshape(-1),
        cell_mm2=cell.reshape(-1),
    )

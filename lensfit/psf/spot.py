"""The spot of one dot: rays through the opening, each with its weight and its width.

Rays fill the opening of the pupil evenly (`optics.pupil`), each standing for a cell of
equal area and carrying the light of that (`optics.aberration`). They are distributed
over the wavelengths in turn: half as many rays as if every point of the opening sent
one of each wavelength are as accurate. The image of a cell is stood for by a round
Gaussian whose variance is proportional to

    A/M |dx/du|^2 / 2,

with A/M the area of a cell: it goes to 0 in focus and at a caustic without singularity,
and the spot's second moment converges like 1/M.

Each Gaussian is integrated over each cell of a patch exactly (differences of the error
function along columns and rows). So a patch is a product of two thin matrices, is
never negative, loses only what falls beside it, and has all derivatives everywhere,
through focus and at caustics: 1/|det dx/du| occurs nowhere. Diffraction widens the
Gaussians: the Airy pattern's core is close to one of 0.42 wavelengths times f-number.

Patches have row 0 on top; cell (column c, row r) covers [c, c + 1) x [r, r + 1). A
cell is a pixel, or a square of pixels.

Every function takes one dot; callers map it over many with `jax.vmap`.

Reference: P. S. Heckbert, Fundamentals of Texture Mapping and Image Warping (1989), for
elliptical weighted averages; here the footprint's trace is enough.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.optics.aberration import (
    Aberration,
    LocalWavefront,
    landing_and_jacobian_mm,
    light_density,
    local_wavefront,
)
from lensfit.optics.depth import ObjectShift
from lensfit.optics.pupil_nodes import PupilNodes
from lensfit.optics.spectrum import REFERENCE_NM

FOOTPRINT = 0.16
"""Variance of a ray's Gaussian over `Spot.cell_mm2`: 0.4 of the spacing of the rays."""
AIRY_SIGMA = 0.42
"""Standard deviation of the Gaussian nearest to an Airy pattern, in wavelength x N."""
LEAST_SIGMA_PX = 0.05
"""No Gaussian is narrower: it keeps derivatives alive where the blur vanishes."""
WAVELENGTH_MM = REFERENCE_NM / 1e6


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
    cylinder_mm : Of an anamorphic lens (`optics.depth`).
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


class Profile(NamedTuple):
    """Share of every ray in the rows and columns of a patch.

    Attributes
    ----------
    rows, columns : The shares.
    rows_moved, columns_moved : Their change per mm that the ray moves down or right.
    """

    rows: Float[Array, "cells rays"]
    columns: Float[Array, "cells rays"]
    rows_moved: Float[Array, "cells rays"]
    columns_moved: Float[Array, "cells rays"]


def profile_of(
    spot: Spot,
    corner_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    cells: int,
    variance_mm2: Float[Array, "*axes"],
) -> Profile:
    """How the rays share their light among rows and columns.

    Parameters
    ----------
    corner_mm : Of cell (0, 0), in the coordinates of the spot.
    cells : Rows and columns (static).
    variance_mm2 : Of the Gaussian that every ray is, besides its own width; one, or one
        along x and one along y.
    """
    position = (spot.landing_mm - corner_mm[None]) / cell_mm[None]
    # One variance serves both axes.
    along_axes = jnp.broadcast_to(variance_mm2, (2,))
    own = FOOTPRINT * spot.cell_mm2
    variance = (along_axes[None] + own[:, None]) / cell_mm[None] ** 2
    sigma = jnp.sqrt(variance + LEAST_SIGMA_PX**2)
    columns, columns_moved = pixel_shares(position[:, 0], sigma[:, 0], cells)
    rows, rows_moved = pixel_shares(position[:, 1], sigma[:, 1], cells)
    return Profile(rows, columns, rows_moved / cell_mm[1], columns_moved / cell_mm[0])


def image_of(spot: Spot, profile: Profile) -> Float[Array, "cells cells"]:
    """Light in every cell; sums to 1 less what falls beside."""
    return (profile.rows * spot.weight[None]) @ profile.columns.T


def pixel_shares(
    position: Float[Array, " rays"], sigma: Float[Array, " rays"], pixels: int
) -> tuple[Float[Array, "pixels rays"], Float[Array, "pixels rays"]]:
    """Share of each Gaussian along one axis in every pixel, and d share / d position.

    Parameters
    ----------
    position, sigma : In pixels, from the edge of the first one.
    pixels : How many (static).
    """
    first = jnp.asarray(np.arange(pixels), position.dtype)
    reach = partial(_reach, position=position, sigma=sigma)
    near, far = reach(first), reach(first + 1)
    # Every inner edge twice: slices of an array of edges would not be vectorised.
    share = (jax.scipy.special.erf(far) - jax.scipy.special.erf(near)) / 2
    height = 1 / (sigma * (2 * np.pi) ** 0.5)[None]
    return share, (jnp.exp(-(near**2)) - jnp.exp(-(far**2))) * height


def _reach(edges: Array, position: Array, sigma: Array) -> Array:
    """From every ray to every edge, as the error function takes it."""
    return (edges[:, None] - position[None]) / (sigma * 2.0**0.5)[None]


def diffraction_variance_mm2(f_number: Float[Array, ""]) -> Float[Array, ""]:
    """Variance of the Gaussian that stands for the Airy pattern."""
    return (AIRY_SIGMA * WAVELENGTH_MM * f_number) ** 2

"""Rays onto pixels: the light of a spot in every cell of a patch.

Each ray is a Gaussian, integrated over each cell exactly (differences of the error
function along columns and rows). So a patch is a product of two thin matrices, is
never negative, loses only what falls beside it, and has all derivatives everywhere,
through focus and at caustics: 1/|det dx/du| occurs nowhere. Diffraction widens the
Gaussians: the Airy pattern's core is close to one of 0.42 wavelengths times f-number.

Patches have row 0 on top; cell (column c, row r) covers [c, c + 1) x [r, r + 1). A
cell is a pixel, or a square of pixels.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.optics.spectrum import REFERENCE_NM
from lensfit.psf.spot import Spot

FOOTPRINT = 0.16
"""Variance of a ray's Gaussian over `Spot.cell_mm2`: 0.4 of the spacing of the rays."""
AIRY_SIGMA = 0.42
"""Standard deviation of the Gaussian nearest to an Airy pattern, in wavelength x N."""
LEAST_SIGMA_PX = 0.05
"""No Gaussian is narrower: it keeps derivatives alive where the blur vanishes."""
WAVELENGTH_MM = REFERENCE_NM / 1e6


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


def diffraction_variance_mm2(
    f_number: Float[Array, ""], wavelength_mm: float = WAVELENGTH_MM
) -> Float[Array, ""]:
    """Variance of the Gaussian that stands for the Airy pattern."""
    return (AIRY_SIGMA * wavelength_mm * f_number) ** 2

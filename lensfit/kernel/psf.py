"""Rays onto pixels: the point-spread function and the image of a dot.

Each ray is a Gaussian, integrated over each pixel exactly (differences of the error
function along columns and rows). So a patch is a product of two thin matrices, is
never negative, loses only what falls beside it, and has all derivatives everywhere,
through focus and at caustics: 1/|det dx/du| occurs nowhere. Diffraction widens the
Gaussians: the Airy pattern's core is close to one of 0.42 wavelengths times f-number.

Patches have row 0 on top; pixel (column c, row r) covers [c, c + 1) x [r, r + 1).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.kernel.spot import FOOTPRINT, Blur, Spot, dot_spot
from lensfit.optics.depth import ObjectShift
from lensfit.optics.pupil import SHARPNESS

AIRY_SIGMA = 0.42
"""Standard deviation of the Gaussian nearest to an Airy pattern, in wavelength x N."""
LEAST_SIGMA_PX = 0.05
"""No Gaussian is narrower: it keeps derivatives alive where the blur vanishes."""
WAVELENGTH_MM = 540e-6


def splat(
    image: Spot,
    origin_mm: Float[Array, "2"],
    pixel_pitch_mm: Float[Array, "2"],
    shape: tuple[int, int],
    variance_mm2: Float[Array, ""],
    footprint: float = FOOTPRINT,
) -> Float[Array, "rows columns"]:
    """Light of a spot in every pixel of a patch; sums to 1 less what falls beside.

    Parameters
    ----------
    origin_mm : Corner of pixel (0, 0), in the coordinates of the spot.
    shape : Rows and columns (static).
    variance_mm2 : Added to every ray's Gaussian: diffraction and the like.
    """
    rows, columns = shape
    position = (image.landing_mm - origin_mm[None]) / pixel_pitch_mm[None]
    variance = variance_mm2 + footprint * image.cell_mm2
    least = LEAST_SIGMA_PX**2
    across = jnp.sqrt(variance / pixel_pitch_mm[0] ** 2 + least)
    down = jnp.sqrt(variance / pixel_pitch_mm[1] ** 2 + least)
    in_columns = pixel_shares(position[:, 0], across, columns)
    in_rows = pixel_shares(position[:, 1], down, rows)
    return (in_rows * image.weight[None]) @ in_columns.T


def psf(
    field_point_mm: Float[Array, "2"],
    blur: Blur,
    stop_radius: Float[Array, ""],
    defocus_mm: Float[Array, ""],
    chromatic: Float[Array, " wavelengths"],
    lateral_mm: Float[Array, "wavelengths 2"],
    f_number: Float[Array, ""],
    pixel_pitch_mm: Float[Array, "2"],
    *,
    size_px: int,
    rays: int = 2048,
    depth: ObjectShift | None = None,
    sharpness: float = SHARPNESS,
) -> Float[Array, "size size"]:
    """Point-spread function, row 0 on top, centred on the green chief ray, sum 1.

    Parameters
    ----------
    field_point_mm : Where the green chief ray lands, from the principal point.
    rays : Through the pupil, for each wavelength.
    """
    image, _ = dot_spot(
        field_point_mm,
        blur,
        stop_radius,
        defocus_mm,
        chromatic,
        lateral_mm,
        rays=rays,
        depth=depth,
        deal=False,
        sharpness=sharpness,
    )
    half = size_px / 2 * pixel_pitch_mm
    variance = diffraction_variance_mm2(f_number)
    patch = splat(image, -half, pixel_pitch_mm, (size_px, size_px), variance)
    return patch / jnp.maximum(jnp.sum(patch), 1e-300)


def diffraction_variance_mm2(
    f_number: Float[Array, ""], wavelength_mm: float = WAVELENGTH_MM
) -> Float[Array, ""]:
    """Variance of the Gaussian that stands for the Airy pattern."""
    return (AIRY_SIGMA * wavelength_mm * f_number) ** 2


def pixel_shares(
    position: Float[Array, " rays"], sigma: Float[Array, " rays"], pixels: int
) -> Float[Array, "pixels rays"]:
    """Share of each Gaussian along one axis in every pixel.

    Parameters
    ----------
    position, sigma : In pixels, from the edge of the first one.
    pixels : How many (static).
    """
    edges = jnp.asarray(np.arange(pixels + 1), position.dtype)
    reach = (edges[:, None] - position[None]) / (sigma * 2.0**0.5)[None]
    below = jax.scipy.special.erf(reach) / 2
    return below[1:] - below[:-1]

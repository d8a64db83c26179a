"""Colour channels as bands of wavelengths, and the coordinate that aberrations follow.

A band is replaced by a few wavelengths of equal weight (Chebyshev's rule, which matches
mean, variance and skewness of any symmetric band with two or three of them): what a
photograph shows of a band is mostly its width.

Refractive index is not linear in wavelength, but nearly so in Buchdahl's coordinate
d / (1 + 2.5 d), d = wavelength - 0.54 um; scaled here so that blue (0.46 um) is at -1.

Reference: H. A. Buchdahl, Optical Aberration Coefficients (1954); P. N. Robb and
R. I. Mercado, Appl. Opt. 22 (1983) 1198.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

REFERENCE_NM = 540.0
CENTRES_NM = (610.0, 540.0, 460.0)
WIDTHS_NM = (26.0, 26.0, 26.0)
"""Standard deviation of a band: that of an even band of 90 nm."""
_BLUE_NM = 460.0
_BUCHDAHL_PER_UM = 2.5
_EQUAL_WEIGHT = {1: (0.0,), 2: (-1.0, 1.0), 3: (-(1.5**0.5), 0.0, 1.5**0.5)}


class Bands(eqx.Module):
    """Wavelengths of equal weight for red, green and blue."""

    wavelengths_nm: Float[Array, "3 nodes"]


def bands(
    nodes: int = 3,
    centres_nm: tuple[float, float, float] = CENTRES_NM,
    widths_nm: tuple[float, float, float] = WIDTHS_NM,
) -> Bands:
    """Red, green and blue with this many wavelengths each (1, 2 or 3).

    Parameters
    ----------
    widths_nm : Standard deviations.
    """
    offsets = np.asarray(_EQUAL_WEIGHT[nodes])
    centres, widths = np.asarray(centres_nm), np.asarray(widths_nm)
    return Bands(jnp.asarray(centres[:, None] + widths[:, None] * offsets))


def chromatic_coordinate(
    wavelength_nm: Float[Array, "*nodes"],
) -> Float[Array, "*nodes"]:
    """0 at 540 nm, -1 at 460 nm, 0.60 at 610 nm."""
    at_blue = _buchdahl((_BLUE_NM - REFERENCE_NM) * 1e-3)
    return _buchdahl((wavelength_nm - REFERENCE_NM) * 1e-3) / -at_blue


def lateral_at(
    chromatic: Float[Array, " nodes"],
    red_mm: Float[Array, "2"],
    blue_mm: Float[Array, "2"],
    band_means: Float[Array, "3"],
) -> Float[Array, "nodes 2"]:
    """Displacement of the chief ray against green's at other wavelengths.

    The parabola through the displacements of the three channels.

    Parameters
    ----------
    red_mm, blue_mm : Displacements of the channels, from `optics.lateral`.
    band_means : Mean chromatic coordinate of red, green and blue.
    """
    w, (r, g, b) = chromatic, band_means
    red = (w - g) * (w - b) / ((r - g) * (r - b))
    blue = (w - g) * (w - r) / ((b - g) * (b - r))
    return jnp.outer(red, red_mm) + jnp.outer(blue, blue_mm)


def _buchdahl(difference_um):
    return difference_um / (1 + _BUCHDAHL_PER_UM * difference_um)

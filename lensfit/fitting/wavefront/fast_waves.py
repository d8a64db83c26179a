"""The sharpest detail of broad dots: waves faster than those that rays are drawn in.

Where blur is much narrower than a cell, the image of an edge has detail up to a few
periods in a cell: a twelfth of its contrast beyond the waves of `waves`. Without it an
edge looks skewed one way or the other, depending on where it lies between cells, by as
much as coma of a tenth of a cell skews it. The blur of a point multiplies these waves
by nearly the same number whatever its shape, since it is narrow beside their period or
else leaves nothing of them: by the transform of the Gaussian with the mean m and the
covariance C of its rays,

    blur^(k) = exp(-i k m - k C k / 2).

So they cost no sum over rays. Along one axis they are as slow as the others: the image
of an edge has little detail that is fast both ways.

Wave numbers are radians per cell of the patch, from its middle, right and down.

Reference: J. W. Goodman, Introduction to Fourier Optics (2005), 2.1 and 6.2, on spread
functions and their transforms.
"""

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Complex, Float

from lensfit.fitting.wavefront.waves import FASTEST, WAVES, FastWaves, wave_numbers
from lensfit.psf.spot import FOOTPRINT, LEAST_SIGMA_PX, Spot


def fast_light(
    spot: Spot,
    fast: FastWaves,
    corner_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    cells: int,
    variance_mm2: Float[Array, "*axes"],
) -> Float[Array, "cells cells"]:
    """Light that these waves add to the image of one dot.

    Parameters
    ----------
    spot : The blur of a point.
    corner_mm, cell_mm, cells : Of the patch.
    variance_mm2 : Of every ray besides its own width, of both axes or of each.
    """
    light = jnp.sum(spot.weight)
    middle_mm = corner_mm + cell_mm * cells / 2
    x = (spot.landing_mm - middle_mm[None]) / cell_mm[None]
    mean = spot.weight @ x / light
    off = x - mean[None]
    own_mm2 = variance_mm2 + FOOTPRINT * jnp.mean(spot.cell_mm2)
    own = jnp.broadcast_to(own_mm2, (2,)) / cell_mm**2 + LEAST_SIGMA_PX**2
    covariance = (spot.weight[:, None] * off).T @ off / light + jnp.diag(own)
    both, half = wave_numbers(cells, FASTEST)
    slow = np.abs(both) <= half[WAVES]
    parts = (
        (fast.right, both[slow], half[WAVES + 1 :]),
        (fast.down, both[~slow], half[: WAVES + 1]),
    )
    drawn = [_drawn(*part, mean, covariance, cells) for part in parts]
    return light * (drawn[0] + drawn[1])


def _drawn(
    pattern: Complex[Array, "down right"],
    down: Float[np.ndarray, " down"],
    right: Float[np.ndarray, " right"],
    mean: Float[Array, "2"],
    covariance: Float[Array, "2 2"],
    cells: int,
) -> Float[Array, "cells cells"]:
    """Light of some of the waves behind a Gaussian."""
    dtype = mean.dtype
    y, x = jnp.asarray(down, dtype)[:, None], jnp.asarray(right, dtype)[None]
    across, both, upright = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    height = jnp.exp(-(across * x * x + 2 * both * x * y + upright * y * y) / 2)
    middle = jnp.asarray(np.arange(cells) + 0.5 - cells / 2, dtype)
    angles = [
        (middle - mean[axis])[:, None] * k.reshape(1, -1)
        for axis, k in enumerate((x, y))
    ]
    columns, rows = (lax.complex(jnp.cos(a), jnp.sin(a)) for a in angles)
    waves = (pattern * height.astype(pattern.dtype)).astype(columns.dtype)
    return jnp.real(rows @ waves @ columns.T)

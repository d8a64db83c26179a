"""The sharpest detail of broad dots: waves faster than those that rays are drawn in.

Where blur is much narrower than a cell, the image of an edge has detail up to a few
periods in a cell: a twelfth of its contrast beyond the waves of `waves`. Without it an
edge looks skewed one way or the other, depending on where it lies between cells, by as
much as coma of a tenth of a cell skews it. The blur of a point multiplies these waves
by nearly the same number whatever its shape, since it is narrow beside their period or
else leaves nothing of them: by the transform of the Gaussian with the mean m and the
covariance C of its rays,

    blur^(k) = exp(-i k m - k C k / 2).

So they cost no sum over rays, and change with the lens through six numbers, the
moments. Along one axis they are as slow as the others: the image of an edge has little
detail that is fast both ways.

Wave numbers are radians per cell of the patch, from its middle, right and down.

Reference: J. W. Goodman, Introduction to Fourier Optics (2005), 2.1 and 6.2, on spread
functions and their transforms.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Complex, Float

from lensfit.fitting.wavefront.basis import Basis
from lensfit.fitting.wavefront.rays import Rays
from lensfit.fitting.wavefront.waves import FASTEST, WAVES, FastWaves, wave_numbers
from lensfit.psf.spot import FOOTPRINT, Spot

_Powers = tuple[tuple[int, int], ...]
"""Of the wave numbers to the right and down that derivatives by moments bring."""
_LIGHT: _Powers = ((0, 0),)
_MEAN: _Powers = ((1, 0), (0, 1))
_SECOND: _Powers = ((2, 0), (1, 1), (0, 2))
_MOMENTS = _LIGHT + _MEAN + _SECOND
"""Of a blur: its light; mean to the right and down; variance to the right, covariance,
and variance down."""


class FastImage(eqx.Module):
    """What these waves add to the image of one dot, for a brightness of 1, and its
    derivatives.

    Attributes
    ----------
    spot : The blur of a point.
    fast : The pattern that it blurs.
    patch : Any basis on the patch.
    variance_mm2 : Of every ray besides its own width, of both axes or of each.
    """

    spot: Spot
    fast: FastWaves
    patch: Basis
    variance_mm2: Float[Array, "*axes"]

    @property
    def light(self) -> Float[Array, " cells2"]:
        """Of every cell."""
        return jnp.sum(self.spot.weight) * self._by_moment(_LIGHT)[:, 0]

    @property
    def shift_slopes(self) -> Float[Array, "cells2 2"]:
        """d light / d shift right and down."""
        return self._by_moment(_MEAN) / self.patch.cell_mm[None]

    def design(self, rays: Rays) -> Float[Array, "cells2 shapes"]:
        """d light / d shape, by rays whose weights sum to 1."""
        by_spot = jax.jacrev(self._moments)(rays.spot)
        by_landing = jnp.einsum(
            "mri,sir->ms", by_spot.landing_mm, rays.landing_slopes_mm
        )
        by_shape = rays.with_weights_changed(by_landing, by_spot.weight)
        return self._by_moment(_MOMENTS) @ by_shape

    def spot_gradient(self, pull: Float[Array, " cells2"]) -> Spot:
        """Sum of `pull` times d light / d spot."""
        _, pullback = jax.vjp(self._moments, self.spot)
        return pullback(pull @ self._by_moment(_MOMENTS))[0]

    def _moments(self, spot: Spot) -> Float[Array, "6"]:
        """Of the blur of a point, cells from the middle of the patch (`_MOMENTS`)."""
        cell_mm = self.patch.cell_mm
        light = jnp.sum(spot.weight)
        x = (spot.landing_mm - self.patch.centre_mm[None]) / cell_mm[None]
        mean = spot.weight @ x / light
        right, down = (x - mean[None]).T
        square = jnp.stack([right * right, right * down, down * down], -1)
        own_mm2 = self.variance_mm2 + FOOTPRINT * jnp.mean(spot.cell_mm2)
        own = jnp.broadcast_to(own_mm2, (2,)) / cell_mm**2
        second = (spot.weight @ square / light).at[::2].add(own)
        return jnp.concatenate([light[None], mean, second])

    def _by_moment(self, powers: _Powers) -> Float[Array, "cells2 moments"]:
        """d light / d moment, of some of them."""
        moments, cells = self._moments(self.spot), self.patch.cells
        both, half = wave_numbers(cells, FASTEST)
        slow = np.abs(both) <= half[WAVES]
        parts = (
            (self.fast.right, both[slow], half[WAVES + 1 :]),
            (self.fast.down, both[~slow], half[: WAVES + 1]),
        )
        drawn = [_drawn(*part, moments, cells, powers) for part in parts]
        return (drawn[0] + drawn[1]).reshape(len(powers), -1).T


def _drawn(
    pattern: Complex[Array, "down right"],
    down: Float[np.ndarray, " down"],
    right: Float[np.ndarray, " right"],
    moments: Float[Array, "6"],
    cells: int,
    powers: _Powers,
) -> Float[Array, "moments cells cells"]:
    """d light / d moment, of some of the waves behind a Gaussian.

    A mean brings -i times a wave number, a covariance the square of that, a variance
    half of it.
    """
    dtype = moments.dtype
    light, mean, (across, mixed, upright) = moments[0], moments[1:3], moments[3:]
    x, y = jnp.asarray(right, dtype)[None], jnp.asarray(down, dtype)[None]
    height = across * x * x + 2 * mixed * x * y.T + upright * (y * y).T
    middle = jnp.asarray(np.arange(cells) + 0.5 - cells / 2, dtype)
    columns, rows = (
        lax.complex(jnp.cos(angle), jnp.sin(angle))
        for angle in ((middle - mean[0])[:, None] * x, (middle - mean[1])[:, None] * y)
    )
    waves = (pattern * jnp.exp(-height / 2).astype(pattern.dtype)).astype(rows.dtype)
    x, y = x.astype(rows.dtype), y.astype(rows.dtype)
    by_rows = {n: (rows * y**n) @ waves for n in {down for _, down in powers}}
    each = []
    for to_right, to_below in powers:
        drawn = by_rows[to_below] @ (columns * x**to_right).T
        slope = jnp.real((-1j) ** (to_right + to_below) * drawn)
        slope = slope / 2 if 2 in (to_right, to_below) else slope
        each.append(slope if (to_right, to_below) in _LIGHT else light * slope)
    return jnp.stack(each)

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

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Complex, Float

from lensfit.fitting.wavefront.rays import Rays
from lensfit.fitting.wavefront.waves import FASTEST, WAVES, FastWaves, wave_numbers
from lensfit.psf.spot import FOOTPRINT, Spot

Powers = tuple[tuple[int, int], ...]
"""Of the wave numbers to the right and down that a derivative brings."""
_LEVEL: Powers = ((0, 0),)
_PLACE: Powers = ((1, 0), (0, 1))
_EVERY: Powers = (*_LEVEL, *_PLACE, (2, 0), (1, 1), (0, 2))
"""By all moments of a blur: its light; mean to the right and down; variance to the
right, covariance, and variance down."""


class FastImage(eqx.Module):
    """What these waves add to the image of one dot, and its derivatives.

    Attributes
    ----------
    moments : Of the blur of a point, cells (`_EVERY`).
    pullback : From a derivative by the moments to that by the spot.
    fast : The pattern.
    middle_mm, cell_mm, cells : Of the patch.
    """

    moments: Float[Array, "6"]
    pullback: Callable[[Float[Array, "6"]], tuple[Spot]]
    fast: FastWaves
    middle_mm: Float[Array, "2"]
    cell_mm: Float[Array, "2"]
    cells: int = eqx.field(static=True)

    @property
    def light(self) -> Float[Array, " cells2"]:
        """Of every cell, for a brightness of 1."""
        return self.moments[0] * self._by_moment(_LEVEL)[:, 0]

    @property
    def shift_slopes(self) -> Float[Array, "cells2 2"]:
        """d light / d shift right and down."""
        return self._by_moment(_PLACE) / self.cell_mm[None]

    def of_pattern(self, fast: FastWaves) -> "FastImage":
        """The same of another pattern."""
        return replace(self, fast=fast)

    def design(self, rays: Rays) -> Float[Array, "cells2 shapes"]:
        """d light / d shape, by rays whose weights sum to 1."""
        at = self.moments, self.middle_mm, self.cell_mm
        return self._by_moment(_EVERY) @ _moment_slopes(rays, *at)

    def spot_gradient(self, pull: Float[Array, " cells2"]) -> Spot:
        """Sum of `pull` times d light / d spot."""
        return self.pullback(pull @ self._by_moment(_EVERY))[0]

    def _by_moment(self, powers: Powers) -> Float[Array, "cells2 moments"]:
        """d light / d moment, of some of them."""
        both, half = wave_numbers(self.cells, FASTEST)
        slow = np.abs(both) <= half[WAVES]
        parts = (
            (self.fast.right, both[slow], half[WAVES + 1 :]),
            (self.fast.down, both[~slow], half[: WAVES + 1]),
        )
        drawn = [_drawn(*part, self.moments, self.cells, powers) for part in parts]
        return (drawn[0] + drawn[1]).reshape(len(powers), -1).T


def fast_image(
    spot: Spot,
    fast: FastWaves,
    corner_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    cells: int,
    variance_mm2: Float[Array, "*axes"],
) -> FastImage:
    """Of one dot.

    Parameters
    ----------
    spot : The blur of a point.
    corner_mm, cell_mm, cells : Of the patch.
    variance_mm2 : Of every ray besides its own width, of both axes or of each.
    """
    middle_mm = corner_mm + cell_mm * cells / 2

    def moments_of(spot: Spot) -> Float[Array, "6"]:
        return _moments(spot, middle_mm, cell_mm, variance_mm2)

    moments, pullback = jax.vjp(moments_of, spot)
    return FastImage(moments, pullback, fast, middle_mm, cell_mm, cells)


def _moments(
    spot: Spot,
    middle_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    variance_mm2: Float[Array, "*axes"],
) -> Float[Array, "6"]:
    """Of the blur of a point."""
    light = jnp.sum(spot.weight)
    x = (spot.landing_mm - middle_mm[None]) / cell_mm[None]
    mean = spot.weight @ x / light
    own_mm2 = variance_mm2 + FOOTPRINT * jnp.mean(spot.cell_mm2)
    own = jnp.broadcast_to(own_mm2, (2,)) / cell_mm**2
    second = spot.weight @ _squares(x - mean[None]) / light
    second = second.at[::2].add(own)
    return jnp.concatenate([light[None], mean, second])


def _moment_slopes(
    rays: Rays,
    moments: Float[Array, "6"],
    middle_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
) -> Float[Array, "6 shapes"]:
    """d moment / d shape."""
    weight = rays.spot.weight
    off = (rays.spot.landing_mm - middle_mm[None]) / cell_mm[None] - moments[None, 1:3]
    across, down = (
        rays.landing_slopes_mm[:, axis] * (weight / cell_mm[axis])[None]
        for axis in (0, 1)
    )
    by_place = [
        jnp.sum(across, 1),
        jnp.sum(down, 1),
        2 * across @ off[:, 0],
        across @ off[:, 1] + down @ off[:, 0],
        2 * down @ off[:, 1],
    ]
    square = _squares(off)
    by_weight = jnp.concatenate(
        [jnp.ones_like(off[:, :1]), off, square - (weight @ square)[None]], 1
    )
    by_light = by_weight.T @ rays.weight_slopes.T
    of_others = len(across) - len(rays.weight_slopes)
    slopes = jnp.pad(jnp.stack(by_place), ((1, 0), (0, 0)))
    return slopes + jnp.pad(by_light, ((0, 0), (of_others, 0)))


def _squares(off: Float[Array, "rays 2"]) -> Float[Array, "rays 3"]:
    """The products of which the second moments are means."""
    x, y = off.T
    return jnp.stack([x * x, x * y, y * y], -1)


def _drawn(
    pattern: Complex[Array, "down right"],
    down: Float[np.ndarray, " down"],
    right: Float[np.ndarray, " right"],
    moments: Float[Array, "6"],
    cells: int,
    powers: Powers,
) -> Float[Array, "moments cells cells"]:
    """d light / d moment, of some of the waves behind a Gaussian."""
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
        if (to_right, to_below) in _PLACE:
            each.append(light * jnp.imag(drawn))
        elif (to_right, to_below) in _LEVEL:
            each.append(jnp.real(drawn))
        else:
            share = 1.0 if to_right == to_below else 0.5
            each.append(-share * light * jnp.real(drawn))
    return jnp.stack(each)

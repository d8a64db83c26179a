"""Polynomials over the box in which the rays of one target land, drawn in waves.

The derivatives of an image are sums over rays of products of waves along both axes,
one sum for each pair of waves and each shape. But rays land close together beside the
period of most waves, and there a wave is a polynomial of low degree: its expansion in
Chebyshev polynomials T_m ends a few terms beyond its wave number times half the width
of the box (the Bessel functions J_m of that product). So sums are taken over pairs of
polynomials, which are far fewer, and drawn in waves once for each shape. Waves that
polynomials of this degree cannot follow are left out: their period is less than a third
of the blur's radius.

Reference: L. N. Trefethen, Approximation Theory and Approximation Practice (2013), on
Chebyshev interpolants.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.fitting.wavefront.basis import Basis
from lensfit.fitting.wavefront.waves import Waves, multiples
from lensfit.psf.spot import Profile, Spot

DEGREES = 24
"""Polynomials along an axis."""
_TERMS_BEYOND = 6
"""Terms that a wave needs beyond its wave number times half the box: what is left of it
is below a twentieth."""
_WIDER = 1.02
"""The box over the rays' own, so that none lands where T_m turns steepest."""
_INSIDE = 1 - 1e-4
"""Part of the box that other rays of the same target are held within."""
_LEAST_CELLS = 0.05
"""Half the width of the narrowest box: one point has none."""


class Polynomials(Basis):
    """T_0, T_1, ... over a box.

    Attributes
    ----------
    corner_mm, cell_mm, cells : Of the patch; cells along a side.
    within : The basis in which they are drawn.
    middle_mm, reach_mm : Of the box, x and y; half its width.
    down, right : Amplitudes of each polynomial in that basis, along both axes.
    """

    corner_mm: Float[Array, "2"]
    cell_mm: Float[Array, "2"]
    cells: int = eqx.field(static=True)
    within: Waves
    middle_mm: Float[Array, "2"]
    reach_mm: Float[Array, "2"]
    down: Float[Array, "waves degrees"]
    right: Float[Array, "waves degrees"]

    @property
    def size(self) -> int:
        """The number of polynomials."""
        return self.down.shape[-1]

    def profile(self, spot: Spot, variance_mm2: Float[Array, "*axes"]) -> Profile:
        """T_m where each ray lands, and its change per mm; the variance is in `down`
        and `right`."""
        del variance_mm2
        place = (spot.landing_mm - self.middle_mm[None]) / self.reach_mm[None]
        place = jnp.clip(place, -_INSIDE, _INSIDE)
        angle = jnp.arccos(place)
        degree = jnp.arange(self.size, dtype=angle.dtype)[:, None]
        (columns, columns_moved), (rows, rows_moved) = (
            (even, degree * odd / (jnp.sin(angle[None, :, axis]) * self.reach_mm[axis]))
            for axis in (0, 1)
            for even, odd in [multiples(angle[:, axis], self.size)]
        )
        return Profile(rows, columns, rows_moved, columns_moved)

    def cell_light(
        self, amplitudes: Float[Array, "*images size size"]
    ) -> Float[Array, "*images cells cells"]:
        """By way of the waves."""
        return self.within.cell_light(self.down @ (amplitudes @ self.right.T))

    def cell_light_transpose(
        self, cotangent: Float[Array, "cells cells"]
    ) -> Float[Array, "size size"]:
        """The transpose of `cell_light`."""
        return self.down.T @ self.within.cell_light_transpose(cotangent) @ self.right


def polynomials_over(
    spot: Spot, waves: Waves, variance_mm2: Float[Array, "*axes"]
) -> Polynomials:
    """Polynomials over the box in which these rays land.

    Parameters
    ----------
    waves : In which they are drawn.
    variance_mm2 : Of every ray besides its own width, of which the mean is taken; of
        both axes or of each.
    """
    low, high = spot.landing_mm.min(0), spot.landing_mm.max(0)
    reach_mm = jnp.maximum((high - low) / 2 * _WIDER, _LEAST_CELLS * waves.cell_mm)
    middle_mm = (low + high) / 2
    turn = (np.arange(DEGREES) + 0.5) * (np.pi / DEGREES)
    nodes = jnp.asarray(np.cos(turn), reach_mm.dtype)[:, None]
    mean_mm2 = jnp.mean(spot.cell_mm2)
    at_nodes = Spot(
        middle_mm[None] + reach_mm[None] * nodes,
        jnp.ones(DEGREES, reach_mm.dtype),
        jnp.full(DEGREES, mean_mm2),
    )
    expand = np.cos(turn[:, None] * np.arange(DEGREES)) * (2 / DEGREES)
    expand[:, 0] /= 2
    drawn = waves.profile(at_nodes, variance_mm2)
    most = (DEGREES - _TERMS_BEYOND) / (reach_mm / waves.cell_mm)
    numbers = jnp.asarray(np.tile(waves.numbers, 2), reach_mm.dtype)[:, None]
    right, down = (
        jnp.where(numbers <= most[axis], part, 0.0) @ jnp.asarray(expand, part.dtype)
        for axis, part in enumerate((drawn.columns, drawn.rows))
    )
    return Polynomials(
        corner_mm=waves.corner_mm,
        cell_mm=waves.cell_mm,
        cells=waves.cells,
        within=waves,
        middle_mm=middle_mm,
        reach_mm=reach_mm,
        down=down,
        right=right,
    )

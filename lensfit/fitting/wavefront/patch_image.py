"""The image of one dot on a patch of cells, and its derivatives by rays and shapes.

Light is a sum of Gaussians, one for each ray, integrated over each cell exactly
(`psf.spot`). It is drawn in a basis (`basis`): by the rays of the spot for the image
and its gradient, by fewer for the Gauss-Newton matrix. Of broad dots `fast_waves` adds
the sharpest detail to each of them. Without it in the matrix, and in the slopes by
shift, a step of the lens that moves edges seems cheaper than it is: solves then end
short of their minimum, and deviations come out too wide.
"""

from collections.abc import Callable
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lensfit.fitting.wavefront.basis import Basis
from lensfit.fitting.wavefront.fast_waves import FastImage
from lensfit.fitting.wavefront.polynomials import polynomials_over
from lensfit.fitting.wavefront.rays import Rays
from lensfit.fitting.wavefront.waves import Transfer, Waves, basis_of
from lensfit.psf.spot import Profile, Spot, image_of

RaysOfGroup = Callable[[Int[Array, ""]], Rays]
"""The rays of a group, by its number."""


class PatchImage(eqx.Module):
    """The image of one dot, for a brightness of 1.

    Attributes
    ----------
    spot : The blur of a point.
    profile : Its rays in the basis, computed once.
    basis : In which it is drawn.
    fast : The sharpest detail; None where it is not drawn.
    variance_mm2 : As for `profile_of`.
    """

    spot: Spot
    profile: Profile
    basis: Basis
    fast: FastImage | None
    variance_mm2: Float[Array, "*axes"]

    @property
    def light(self) -> Float[Array, " cells2"]:
        """Of every cell."""
        light = self.basis.cell_light(image_of(self.spot, self.profile)).reshape(-1)
        return light if self.fast is None else light + self.fast.light

    @property
    def shift_slopes(self) -> Float[Array, "cells2 2"]:
        """d light / d shift right and down."""
        spot, profile = self.spot, self.profile
        across = (profile.rows * spot.weight[None]) @ profile.columns_moved.T
        down = (profile.rows_moved * spot.weight[None]) @ profile.columns.T
        slopes = self.basis.cell_light(jnp.stack([across, down])).reshape(2, -1).T
        return slopes if self.fast is None else slopes + self.fast.shift_slopes

    def design(
        self, rays_of_group: RaysOfGroup, groups: Int[Array, ""]
    ) -> Float[Array, "cells2 shapes"]:
        """d light / d shape: the mean over groups of rays."""
        basis = self.basis
        if isinstance(basis, Waves):
            # All waves: shifts then explain no more and no less of it than they should.
            basis = polynomials_over(self.spot, basis, self.variance_mm2)

        def of_group(index: Array) -> Array:
            return self._design_of_rays(rays_of_group(index), basis)

        drawn = jax.eval_shape(of_group, groups)
        total = jax.lax.fori_loop(
            jnp.zeros_like(groups),
            groups,
            lambda index, total: total + of_group(index),
            jnp.zeros(drawn.shape, drawn.dtype),
        )
        return total / groups.astype(drawn.dtype)

    def spot_gradient(self, pull: Float[Array, " cells2"]) -> Spot:
        """Sum of `pull` times d light / d spot."""
        cells = self.basis.cells
        drawn = self.basis.cell_light_transpose(pull.reshape(cells, cells))
        found = _spot_gradient(self.spot, self.profile, drawn)
        if self.fast is None:
            return found
        return jax.tree.map(jnp.add, found, self.fast.spot_gradient(pull))

    def of_transfer(self, transfer: Transfer) -> "PatchImage":
        """That of another broad dot behind the same blur."""
        assert isinstance(self.basis, Waves)
        basis = self.basis.of_transfer(transfer)
        fast = _fast_image(self.spot, transfer, basis, self.variance_mm2)
        return replace(self, basis=basis, fast=fast)

    def _design_of_rays(
        self, rays: Rays, basis: Basis
    ) -> Float[Array, "cells2 shapes"]:
        """Of one group."""
        profile = basis.profile(rays.spot, self.variance_mm2)
        weight = rays.spot.weight[None]
        # Three products: one of arrays put together takes twice as long.
        across = _products(profile.rows, profile.columns_moved * weight)
        down = _products(profile.rows_moved, profile.columns * weight)
        light = _products(profile.rows, profile.columns)
        to_right, to_below = rays.landing_slopes_mm[:, 0], rays.landing_slopes_mm[:, 1]
        moved = across @ to_right.T + down @ to_below.T
        drawn = rays.with_weights_changed(moved, light)
        shapes = drawn.T.reshape(-1, basis.size, basis.size)
        found = basis.cell_light(shapes).reshape(len(shapes), -1).T
        return found if self.fast is None else found + self.fast.design(rays)


def patch_image(
    spot: Spot,
    transfer: Transfer | None,
    corner_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    cells: int,
    variance_mm2: Float[Array, "*axes"],
    waves: int,
) -> PatchImage:
    """The image of one dot.

    Parameters
    ----------
    transfer : Of a broad dot's disc and of its neighbours'; None of others.
    corner_mm, cell_mm : Of the patch.
    cells : Along its side (static).
    waves : As for `basis_of` (static).
    """
    basis = basis_of(corner_mm, cell_mm, cells, transfer, waves)
    fast = _fast_image(spot, transfer, basis, variance_mm2)
    profile = basis.profile(spot, variance_mm2)
    return PatchImage(spot, profile, basis, fast, variance_mm2)


def _fast_image(
    spot: Spot,
    transfer: Transfer | None,
    basis: Basis,
    variance_mm2: Float[Array, "*axes"],
) -> FastImage | None:
    """The sharpest detail, where it is drawn."""
    if transfer is None or transfer.fast is None:
        return None
    return FastImage(spot, transfer.fast, basis, variance_mm2)


def _spot_gradient(
    spot: Spot, profile: Profile, pull: Float[Array, "size size"]
) -> Spot:
    """Sum of `pull` times d drawn / d spot."""
    light = pull @ profile.columns
    across = jnp.sum(profile.rows * (pull @ profile.columns_moved), 0)
    down = jnp.sum(profile.rows_moved * light, 0)
    return Spot(
        spot.weight[:, None] * jnp.stack([across, down], -1),
        jnp.sum(profile.rows * light, 0),
        jnp.zeros_like(spot.cell_mm2),
    )


def _products(rows: Array, columns: Array) -> Float[Array, "size2 rays"]:
    """Amplitude of every ray in every pair of functions."""
    return (rows[:, None] * columns[None]).reshape(-1, rows.shape[-1])

"""The image of one dot on a patch of cells, with its derivatives.

Light is a sum of Gaussians, one for each ray, integrated over each cell exactly
(`psf.spot`). Brightness, background and position of a dot are nuisance parameters:
brightness, background and both shifts are solved for in every patch, in closed form, so
that the wavefront has to explain only what they cannot (variable projection, G. H.
Golub and V. Pereyra, Inverse Problems 19 (2003) R1). Around broad dots, which may be
dark ones on paper, the background may slope, as uneven light and fall-off make it.
Their discs may be a little larger or smaller, as ink and tools leave them, within the
known standard deviation. Squares around a corner, and large dots of which a part of the
rim is shown, fill the patch: there uneven light slopes what is bright. Moving a dot
along its rim changes nothing: a prior of one cell keeps the shifts near their values.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float, Int

from lensfit.fitting.wavefront.basis import Basis
from lensfit.fitting.wavefront.fast_waves import fast_light
from lensfit.fitting.wavefront.polynomials import polynomials_over
from lensfit.fitting.wavefront.rays import Rays
from lensfit.fitting.wavefront.waves import (
    DESIGN_WAVES,
    WAVES,
    Transfer,
    Waves,
    basis_of,
)
from lensfit.psf.spot import Profile, Spot, image_of

_JITTER = 1e-9
_DARKEST = 1e-30
"""Square of the brightness of a dot that is none."""


DesignRays = tuple[Callable[[Int[Array, ""]], Rays], Int[Array, ""]]
"""The rays of each group by its number, and how many groups there are."""


class Patch(NamedTuple):
    """Contribution of one patch to the normal equations.

    Attributes
    ----------
    matrix, chi_squared : Half the second derivative of the sum of weighted squares, by
        shapes, and itself, nuisance solved for.
    spot_gradient : Half its derivative with respect to the spot.
    nuisance : Brightness, background, shift right and down, mm, and the share by which
        a broad dot is larger.
    residual : Photograph minus model, of every cell.
    """

    matrix: Float[Array, "shapes shapes"]
    chi_squared: Float[Array, ""]
    spot_gradient: Spot
    nuisance: Float[Array, "5"]
    residual: Float[Array, " cells"]


def equations_of(
    spot: Spot,
    design_rays: DesignRays,
    light: Float[Array, "cells cells"],
    weight: Float[Array, "cells cells"],
    corner_mm: Float[Array, "2"],
    cell_mm: Float[Array, "2"],
    variance_mm2: Float[Array, "*axes"],
    transfer: Transfer | None = None,
    waves: int = WAVES,
) -> Patch:
    """Normal equations of one patch.

    Parameters
    ----------
    spot : What the image is made of, and the gradient: a gradient from other rays than
        the image's would vanish elsewhere than at the best fit.
    design_rays : Of the Gauss-Newton matrix, which needs less accuracy.
    variance_mm2 : As for `profile_of`.
    transfer : Of a broad dot's disc and of its neighbours'.
    waves : As for `basis_of`; the matrix is made of fewer.
    """
    draw = partial(basis_of, corner_mm, cell_mm, light.shape[0])
    basis = draw(transfer, waves)
    design_basis = draw(transfer, min(waves, DESIGN_WAVES))
    if isinstance(design_basis, Waves):
        design_basis = polynomials_over(spot, design_basis, variance_mm2)
    profile = basis.profile(spot, variance_mm2)
    nuisance_design = _nuisance_design(spot, profile, basis)
    fast = None if transfer is None else transfer.fast
    if fast is not None:
        patch = corner_mm, cell_mm, light.shape[0], variance_mm2
        sharp, fast_pullback = jax.vjp(lambda s: fast_light(s, fast, *patch), spot)
        nuisance_design = nuisance_design.at[:, 0].add(sharp.reshape(-1))
    target, w = light.reshape(-1), weight.reshape(-1)
    nuisance_prior = None
    if transfer is not None:
        sized = draw(transfer.as_size_slope, waves).cell_light(image_of(spot, profile))
        nuisance_design = _with_uneven_light(nuisance_design, sized, transfer.edges)
        nuisance_prior = _NuisancePrior(transfer.width, jnp.max(cell_mm))
    nuisance = _best_nuisance(nuisance_design, target, w, nuisance_prior)
    if transfer is not None:
        basis = draw(transfer.with_size_excess(nuisance.size_excess), waves)
    values, bright = nuisance.values, nuisance.values[0]
    residual = target - nuisance_design @ values
    design = bright * _design(design_rays, variance_mm2, design_basis)
    coupling = nuisance_design.T @ (w[:, None] * design)
    follows = _scaled_solution(nuisance.inner, coupling)
    # The design projected off the nuisance, not a difference of matrices: that would
    # lose its smallest eigenvalues in single precision.
    projected = design - nuisance_design @ follows
    matrix = projected.T @ (w[:, None] * projected)
    matrix = matrix + follows.T @ (nuisance.precision[:, None] * follows)
    pull = bright * (w * residual).reshape(light.shape)
    shift = values[2:4] / _not_zero(bright)
    spot_gradient = spot_gradient_of(spot, profile, -basis.cell_light_transpose(pull))
    if fast is not None:
        (of_fast,) = fast_pullback(-pull)
        spot_gradient = jax.tree.map(jnp.add, spot_gradient, of_fast)
    return Patch(
        matrix,
        jnp.sum(w * residual**2) + nuisance.cost,
        spot_gradient,
        jnp.concatenate([values[:2], shift, nuisance.size_excess[None]]),
        residual,
    )


class _Nuisance(NamedTuple):
    """Nuisance parameters of a patch at their best fit.

    Attributes
    ----------
    inner : Its normal equations.
    precision : The part of these that the prior adds.
    values : In the order of the design.
    size_excess : Share by which the discs of a broad dot are larger.
    cost : Its square in standard deviations.
    """

    inner: Float[Array, "nuisance nuisance"]
    precision: Float[Array, " nuisance"]
    values: Float[Array, " nuisance"]
    size_excess: Float[Array, ""]
    cost: Float[Array, ""]


class _NuisancePrior(NamedTuple):
    """Prior standard deviations of nuisance parameters.

    Attributes
    ----------
    size : Of the share by which discs are larger, times the brightness the last of the
        nuisance.
    place_mm : Of both shifts.
    """

    size: Float[Array, ""]
    place_mm: Float[Array, ""]


def _best_nuisance(
    design: Float[Array, "cells2 nuisance"],
    target: Float[Array, " cells2"],
    w: Float[Array, " cells2"],
    nuisance_prior: _NuisancePrior | None,
) -> _Nuisance:
    """By least squares.

    Parameters
    ----------
    nuisance_prior : Of broad targets; None for others, whose nuisance is free and has
        no size.
    """
    inner, seen = design.T @ (w[:, None] * design), design.T @ (w * target)
    if nuisance_prior is None:
        none = jnp.zeros((), w.dtype)
        free = jnp.zeros(len(inner), w.dtype)
        return _Nuisance(inner, free, _scaled_solution(inner, seen), none, none)
    bright = _scaled_solution(inner[:-1, :-1], seen[:-1])[0]
    by_size, by_place = (
        1 / jnp.maximum((bright * d) ** 2, _DARKEST) for d in nuisance_prior
    )
    precision = jnp.zeros(len(inner), w.dtype).at[2:4].set(by_place).at[-1].set(by_size)
    inner = inner + jnp.diag(precision)
    values = _scaled_solution(inner, seen)
    size_excess = values[-1] / _not_zero(values[0])
    return _Nuisance(
        inner, precision, values, size_excess, jnp.sum(precision * values**2)
    )


def _not_zero(bright: Array) -> Array:
    """1 in place of 0: for a dot without light any brightness will do."""
    return jnp.where(bright == 0, 1.0, bright)


def _nuisance_design(spot: Spot, profile: Profile, basis: Basis) -> Array:
    """d light / d brightness, background and both shifts: (cells^2, 4)."""
    drawn = jnp.stack([image_of(spot, profile), *_shift_slopes(spot, profile)])
    image, across, down = basis.cell_light(drawn).reshape(3, -1)
    return jnp.stack([image, jnp.ones_like(image), across, down], -1)


def _with_uneven_light(
    design: Float[Array, "cells2 4"],
    size_slope: Float[Array, "cells cells"],
    edges: Float[Array, ""],
) -> Float[Array, "cells2 9"]:
    """The nuisance of a broad target: slopes of the background, of edges slopes of the
    bright part too, and its size."""
    slopes = _slopes(len(size_slope), design.dtype)
    uneven = edges * design[:, :1] * slopes
    return jnp.concatenate([design, slopes, uneven, size_slope.reshape(-1, 1)], -1)


def _slopes(cells: int, dtype: DTypeLike) -> Float[Array, "cells2 2"]:
    """d light / d slope of the background, from edge to edge to the right and down."""
    along = jnp.linspace(-1, 1, cells, dtype=dtype)
    return jnp.stack([jnp.tile(along, cells), jnp.repeat(along, cells)], -1)


def _design(
    design_rays: DesignRays, variance_mm2: Float[Array, "*axes"], basis: Basis
) -> Float[Array, "cells2 shapes"]:
    """d image / d shape, for a brightness of 1: the mean over groups of rays."""
    rays_of_group, groups = design_rays

    def of_group(index: Array) -> Array:
        return _design_of_rays(rays_of_group(index), variance_mm2, basis)

    drawn = jax.eval_shape(of_group, groups)
    total = jax.lax.fori_loop(
        jnp.zeros_like(groups),
        groups,
        lambda index, total: total + of_group(index),
        jnp.zeros(drawn.shape, drawn.dtype),
    )
    return total / groups.astype(drawn.dtype)


def _design_of_rays(
    rays: Rays, variance_mm2: Float[Array, "*axes"], basis: Basis
) -> Float[Array, "cells2 shapes"]:
    """Of one group."""
    profile = basis.profile(rays.spot, variance_mm2)
    weight = rays.spot.weight[None]
    # Three products: one of arrays put together takes twice as long.
    across = _products(profile.rows, profile.columns_moved * weight)
    down = _products(profile.rows_moved, profile.columns * weight)
    light = _products(profile.rows, profile.columns)
    moved = (
        across @ rays.landing_slopes_mm[:, 0].T + down @ rays.landing_slopes_mm[:, 1].T
    )
    of_others = moved.shape[1] - len(rays.weight_slopes)
    drawn = moved + jnp.pad(light @ rays.weight_slopes.T, ((0, 0), (of_others, 0)))
    shapes = drawn.T.reshape(-1, basis.size, basis.size)
    return basis.cell_light(shapes).reshape(len(shapes), -1).T


def _products(rows: Array, columns: Array) -> Float[Array, "size2 rays"]:
    """Amplitude of every ray in every pair of functions."""
    return (rows[:, None] * columns[None]).reshape(-1, rows.shape[-1])


def spot_gradient_of(
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


def _shift_slopes(spot: Spot, profile: Profile) -> tuple[Array, Array]:
    """d image / d shift right and down."""
    across = (profile.rows * spot.weight[None]) @ profile.columns_moved.T
    down = (profile.rows_moved * spot.weight[None]) @ profile.columns.T
    return across, down


def _scaled_solution(inner: Array, right: Array) -> Array:
    """inner^-1 right, scaled so that float32 does."""
    size = jnp.sqrt(jnp.diagonal(inner))
    size = jnp.where(size > 0, size, 1.0)
    scaled = inner / (size[:, None] * size[None])
    scaled = scaled + _JITTER * jnp.eye(len(inner), dtype=inner.dtype)
    right = right / (size if right.ndim == 1 else size[:, None])
    found = jnp.linalg.solve(scaled, right)
    return found / (size if right.ndim == 1 else size[:, None])

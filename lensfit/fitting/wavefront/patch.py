"""The share of one dot in the normal equations: its image against the photograph.

Brightness, background and position of a dot are nuisance parameters: brightness,
background and both shifts are solved for in every patch, in closed form, so that the
wavefront has to explain only what they cannot (variable projection, G. H. Golub and V.
Pereyra, Inverse Problems 19 (2003) R1). Sharp edges are moved first. Around broad dots,
which may be dark ones on paper, the background may slope, as uneven light and fall-off
make it. Their discs may be a little larger or smaller, as ink and tools leave them,
within the known standard deviation. Squares around a corner, and large dots of which a
part of the rim is shown, fill the patch: there uneven light slopes what is bright.
Moving a dot along its rim changes nothing: a prior of one cell keeps the shifts near
their values. The image itself and its derivatives are those of `patch_image`.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lensfit.fitting.wavefront.patch_image import PatchImage, RaysOfGroup, patch_image
from lensfit.fitting.wavefront.waves import WAVES, Transfer
from lensfit.psf.spot import Spot

_JITTER = 1e-9
_DARKEST = 1e-30
"""Square of the brightness of a dot that is none."""
_FEWER = 4
"""One ray in so many shows about where a dot is."""
_UNEVEN = slice(6, 8)
"""Of a broad dot's nuisance: how what is bright slopes."""


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
    design_rays: tuple[RaysOfGroup, Int[Array, ""]],
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
    design_rays : Of the Gauss-Newton matrix, which needs less accuracy: by the number
        of their group, and how many groups there are.
    variance_mm2 : As for `profile_of`.
    transfer : Of a broad dot's disc and of its neighbours'.
    waves : As for `basis_of`.
    """
    target, w = light.reshape(-1), weight.reshape(-1)

    at = cell_mm, light.shape[0], variance_mm2, waves
    moved_mm = jnp.zeros_like(corner_mm)
    if transfer is not None and transfer.fast is not None:
        # Sharp edges are not linear over a tenth of a cell: first near, then exactly.
        near = patch_image(_fewer_rays(spot), transfer, corner_mm, *at)
        _, nuisance = _with_nuisance(near, transfer, target, w)
        moved_mm = jnp.clip(_shift_mm(nuisance), -cell_mm, cell_mm)
    image = patch_image(spot, transfer, corner_mm - moved_mm, *at)
    nuisance_design, nuisance = _with_nuisance(image, transfer, target, w)
    values = nuisance.values
    residual = target - nuisance_design @ values
    bright = values[0] * jnp.ones_like(w)
    if transfer is not None:
        bright = bright + transfer.edges * (_slopes(w) @ values[_UNEVEN])
        image = image.of_transfer(transfer.with_size_excess(nuisance.size_excess))
    design = bright[:, None] * image.design(*design_rays)
    coupling = nuisance_design.T @ (w[:, None] * design)
    follows = _scaled_solution(nuisance.inner, coupling)
    # The design projected off the nuisance, not a difference of matrices: that would
    # lose its smallest eigenvalues in single precision.
    projected = design - nuisance_design @ follows
    matrix = projected.T @ (w[:, None] * projected)
    matrix = matrix + follows.T @ (nuisance.precision[:, None] * follows)
    shift_mm = moved_mm + _shift_mm(nuisance)
    return Patch(
        matrix,
        jnp.sum(w * residual**2) + nuisance.cost,
        image.spot_gradient(-bright * w * residual),
        jnp.concatenate([values[:2], shift_mm, nuisance.size_excess[None]]),
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


def _fewer_rays(spot: Spot) -> Spot:
    """Some of its rays, each in place of several."""
    some = jax.tree.map(lambda part: part[::_FEWER], spot)
    return Spot(some.landing_mm, _FEWER * some.weight, _FEWER * some.cell_mm2)


def _with_nuisance(
    image: PatchImage,
    transfer: Transfer | None,
    target: Float[Array, " cells2"],
    w: Float[Array, " cells2"],
) -> tuple[Float[Array, "cells2 nuisance"], _Nuisance]:
    """d light / d nuisance, and the nuisance at its best fit."""
    level = jnp.stack([image.light, jnp.ones_like(target)], -1)
    design = jnp.concatenate([level, image.shift_slopes], 1)
    if transfer is None:
        return design, _best_nuisance(design, target, w, None)
    sized = image.of_transfer(transfer.as_size_slope).light
    design = _with_uneven_light(design, sized, transfer.edges)
    prior = _NuisancePrior(transfer.width, jnp.max(image.basis.cell_mm))
    return design, _best_nuisance(design, target, w, prior)


def _shift_mm(nuisance: _Nuisance) -> Float[Array, "2"]:
    """Right and down."""
    return nuisance.values[2:4] / _not_zero(nuisance.values[0])


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


def _with_uneven_light(
    design: Float[Array, "cells2 4"],
    size_slope: Float[Array, " cells2"],
    edges: Float[Array, ""],
) -> Float[Array, "cells2 9"]:
    """The nuisance of a broad target: slopes of the background, of edges slopes of the
    bright part too, and its size."""
    slopes = _slopes(size_slope)
    uneven = edges * design[:, :1] * slopes
    return jnp.concatenate([design, slopes, uneven, size_slope[:, None]], -1)


def _slopes(of_cells: Float[Array, " cells2"]) -> Float[Array, "cells2 2"]:
    """d light / d slope of the background, from edge to edge to the right and down."""
    cells = math.isqrt(len(of_cells))
    along = jnp.linspace(-1, 1, cells, dtype=of_cells.dtype)
    return jnp.stack([jnp.tile(along, cells), jnp.repeat(along, cells)], -1)


def _scaled_solution(inner: Array, right: Array) -> Array:
    """inner^-1 right, scaled so that float32 does."""
    size = jnp.sqrt(jnp.diagonal(inner))
    size = jnp.where(size > 0, size, 1.0)
    scaled = inner / (size[:, None] * size[None])
    scaled = scaled + _JITTER * jnp.eye(len(inner), dtype=inner.dtype)
    right = right / (size if right.ndim == 1 else size[:, None])
    found = jnp.linalg.solve(scaled, right)
    return found / (size if right.ndim == 1 else size[:, None])

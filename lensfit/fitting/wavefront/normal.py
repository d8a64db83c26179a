"""Normal equations of all dots: one pass over the patches, float32 within each.

Dots are sharded over the cores of the processor.

Single precision is enough for light on cells, which a photograph knows to
three digits; sums over patches are float64.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lensfit.fitting.device_mesh import (
    SHARDED,
    SHARED,
    on_every_core,
    summed_over_cores,
)
from lensfit.fitting.wavefront.dot_arrays import Dots, Pixels
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.patch import Patch, equations_of
from lensfit.fitting.wavefront.rays import (
    Rays,
    open_pupil_of,
    rays_of,
    spot_and_pullback,
)
from lensfit.fitting.wavefront.shapes import colours_of, shape_jacobian
from lensfit.fitting.wavefront.waves import WAVES, Transfer
from lensfit.optics.pupil_nodes import RayGroup

FOLDS = 32
"""Two for each of up to sixteen takes; more takes share them."""


class Points(NamedTuple):
    """Rays through the pupil, multiples of three: speed against error.

    Attributes
    ----------
    image : For the light on the cells, and the gradient: with 768 images are 1 to 2 %
        wrong, with 1536 half of that, and a pass takes half as long again.
    design : Of each group of rays (`Model.ray_groups`) for the Gauss-Newton matrix,
        which needs less accuracy.
    waves : Number of waves that broad dots are drawn in (`waves`).
    """

    image: int = 1536
    design: int = 96
    waves: int = WAVES


DEFAULT_POINTS = Points()


class Equations(NamedTuple):
    """Normal equations of every fold of the dots, without priors.

    Two folds for each take, so that half of a take's dots, or any take, can be held out
    without a new fit.

    Attributes
    ----------
    matrix, gradient, chi_squared : Half the second derivative of the sum of weighted
        squares, half its first, and itself.
    """

    matrix: Float[Array, "folds parameters parameters"]
    gradient: Float[Array, "folds parameters"]
    chi_squared: Float[Array, " folds"]


class PerDot(NamedTuple):
    """Results of every patch.

    Attributes
    ----------
    gradient : Share of each dot and channel in the gradient.
    nuisance : Of each channel (`patch.Patch`).
    residual : Photograph minus model.
    """

    gradient: Float[Array, "dots 3 parameters"]
    nuisance: Float[Array, "dots 3 5"]
    residual: Float[Array, "dots 3 cells"]


class Model(NamedTuple):
    """Constants of a pass.

    Attributes
    ----------
    wavelengths_nm : Of each channel, its band as wide as usual.
    transfer : Of broad dots (`waves`); None for others.
    smoothing : Variance by which model and photograph were both smoothed, cells.
    count : Dots in use, of each core's share; the rest of it is padding.
    ray_groups : Groups of rays that the Gauss-Newton matrix is made of.
    """

    dots: Dots
    pixels: Pixels
    transfer: Transfer | None
    scale: Scale
    wavelengths_nm: Float[Array, "3 wavelengths"]
    smoothing: Float[Array, ""]
    count: Int[Array, " cores"]
    ray_groups: Int[Array, ""]


def normal_equations(
    parameters: Float[Array, " parameters"],
    model: Model,
    layout: Layout,
    points: Points,
) -> tuple[Equations, PerDot]:
    """Normal equations of the dots in use at these parameters, and results per dot."""

    def share(parameters: Array, model: Model) -> tuple[Equations, PerDot]:
        found, per_dot = _pass_of_core(parameters, model, layout, points)
        return summed_over_cores(found), per_dot

    of_model = Model(
        dots=SHARDED,
        pixels=SHARDED,
        transfer=SHARDED,
        scale=SHARED,
        wavelengths_nm=SHARED,
        smoothing=SHARED,
        count=SHARDED,
        ray_groups=SHARED,
    )
    pass_of_all = on_every_core(
        share, takes=(SHARED, of_model), gives=(SHARED, SHARDED)
    )
    return pass_of_all(parameters, model)


def _pass_of_core(
    parameters: Float[Array, " parameters"],
    model: Model,
    layout: Layout,
    points: Points,
) -> tuple[Equations, PerDot]:
    """Of one core's share of the dots."""
    single = jax.tree.map(as_float32, model)
    numbers = parameters.astype(jnp.float32)
    size, dots = layout.size, model.pixels.fold.shape[0]
    cells = model.pixels.light.shape[-1] ** 2

    def one(k: Array, carry):
        equations, per_dot = carry
        dot = jax.tree.map(lambda a: a[k], single.dots)
        pixels = jax.tree.map(lambda a: a[k], single.pixels)
        transfer = jax.tree.map(lambda a: a[k], single.transfer)
        found, gradient = _patches_of_dot(
            numbers, dot, pixels, transfer, single, layout, points
        )
        fold = pixels.fold
        jacobian = shape_jacobian(dot, layout, single.scale)
        matrix = jacobian.T @ jnp.sum(found.matrix, 0) @ jacobian
        equations = Equations(
            equations.matrix.at[fold].add(matrix.astype(jnp.float64)),
            equations.gradient.at[fold].add(_total(gradient)),
            equations.chi_squared.at[fold].add(_total(found.chi_squared)),
        )
        per_dot = PerDot(
            per_dot.gradient.at[k].set(gradient.astype(jnp.float64)),
            per_dot.nuisance.at[k].set(found.nuisance),
            per_dot.residual.at[k].set(found.residual),
        )
        return equations, per_dot

    start = (
        Equations(
            jnp.zeros((FOLDS, size, size)),
            jnp.zeros((FOLDS, size)),
            jnp.zeros(FOLDS),
        ),
        PerDot(
            jnp.zeros((dots, 3, size)),
            jnp.zeros((dots, 3, 5), jnp.float32),
            jnp.zeros((dots, 3, cells), jnp.float32),
        ),
    )
    return jax.lax.fori_loop(0, model.count[0], one, start)


def as_float32(array: Array) -> Array:
    """Floating point arrays in single precision, others as they are."""
    array = jnp.asarray(array)
    floating = jnp.issubdtype(array.dtype, jnp.floating)
    return array.astype(jnp.float32) if floating else array


def _total(of_channels: Array) -> Array:
    return jnp.sum(of_channels.astype(jnp.float64), 0)


def _patches_of_dot(
    parameters: Array,
    dot: Dots,
    pixels: Pixels,
    transfer: Transfer | None,
    model: Model,
    layout: Layout,
    points: Points,
) -> tuple[Patch, Array]:
    """All three channels of one dot, stacked, and their gradients."""
    variance = dot.variance_mm2 + model.smoothing * dot.cell_mm**2
    pupil = open_pupil_of(parameters, dot, layout, model.scale)

    def channel(colour, light, weight, corner):
        seen = (dot, colour, layout, model.scale)

        def design_rays(index: Array) -> Rays:
            group = RayGroup(index, model.ray_groups)
            return rays_of(parameters, *seen, points.design, pupil, group)

        spot, pullback = spot_and_pullback(parameters, *seen, points.image)
        patch = equations_of(
            spot,
            (design_rays, model.ray_groups),
            light,
            weight,
            corner,
            dot.cell_mm,
            variance,
            transfer,
            points.waves,
        )
        return patch, pullback(patch.spot_gradient)

    colours = colours_of(parameters, dot, model.wavelengths_nm, layout)
    return jax.vmap(channel)(colours, pixels.light, pixels.weight, pixels.corner_mm)

"""Rays of one dot through one channel, and their derivatives by every parameter.

A photograph depends on a lens through where rays land and how much light each carries.
The image is made of many rays, of which the gradient needs only sums
(`spot_and_pullback`). The Gauss-Newton matrix needs the derivative of every ray by
every parameter (`rays_of`), of few rays. Both are closed forms for the wavefront, in
which landing points are linear (`shapes`). The few parameters of the pupil, which move
the rays that fill it, are differentiated by JAX.

The point where a ray leaves the dot aperture (`dot_aperture`) is given, and shifts its
landing point. The width of a ray's Gaussian (`psf.spot`) is held constant in all
derivatives: it only stands for rays in between, and vanishes as rays get many. So is
the light that an area of the pupil carries (`optics.aberration`), which varies by a few
percent.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.fitting.wavefront.dot_aperture import ray_origins_mm
from lensfit.fitting.wavefront.dot_arrays import Dots
from lensfit.fitting.wavefront.parameters import (
    Layout,
    Scale,
    aberration_of,
    fitted_stop_radius,
    pupil_of,
)
from lensfit.fitting.wavefront.shapes import (
    Colour,
    band_width_shape_mm,
    chromatic_shapes,
    chromatic_slopes_mm,
    field_point,
    mode_shapes_mm,
    shape_jacobian,
    state_shapes_mm,
)
from lensfit.optics.depth import ObjectShift, cylinder_mm
from lensfit.optics.pupil import Pupil
from lensfit.optics.pupil_nodes import (
    ALL_RAYS,
    FEWEST_SPOKES,
    Opening,
    PupilNodes,
    RayGroup,
    nodes_in,
    opening_on_spokes,
    pupil_nodes,
)
from lensfit.psf.spot import Landed, Spot, landed_rays, split_by_wavelength, spot_of

_TURNS_PER_MM = 12.9898, 78.233
"""Of the spiral of rays, per mm of the field: so many that neighbouring dots have
unrelated patterns."""
SHARPNESS = 64.0
"""Of the pupil's corners: enough for pixels, and steadier than what a kernel uses."""


class OpenPupil(NamedTuple):
    """The pupil of a dot, whichever rays fill it.

    Attributes
    ----------
    opening : Of the pupil.
    slopes : d `opening` / d parameter of the pupil, on the last axis.
    """

    opening: Opening
    slopes: Opening


class Rays(NamedTuple):
    """Where the rays of a dot land, and the derivatives by shapes (`shapes`).

    `shapes.shape_jacobian` gives the derivatives of those by the parameters.

    Attributes
    ----------
    spot : Landing points from where the chief ray lands, weights and widths.
    landing_slopes_mm : d landing / d shape, x and y.
    weight_slopes : d weight / d shape, of the last shapes, those of the pupil.
    """

    spot: Spot
    landing_slopes_mm: Float[Array, "shapes 2 rays"]
    weight_slopes: Float[Array, "pupil rays"]

    def with_weights_changed(
        self,
        by_landing: Float[Array, "numbers shapes"],
        by_weight: Float[Array, "numbers rays"],
    ) -> Float[Array, "numbers shapes"]:
        """Derivatives of some numbers by shapes: what moving rays changes, and what
        their weights do.

        Parameters
        ----------
        by_landing : The first part.
        by_weight : d number / d weight.
        """
        of_others = by_landing.shape[1] - len(self.weight_slopes)
        by_pupil = by_weight @ self.weight_slopes.T
        return by_landing + jnp.pad(by_pupil, ((0, 0), (of_others, 0)))


class PupilRays(NamedTuple):
    """Rays through points of the pupil, and the pullback of derivatives.

    Attributes
    ----------
    u : Their points in the pupil.
    landed : Their landing points.
    to_pupil_parameters : From derivatives by u and by the weight of its rays to
        one by the parameters of the pupil.
    """

    u: Float[Array, "wavelengths points 2"]
    landed: Landed
    to_pupil_parameters: Callable[[tuple[Array, Array]], tuple[Array]]

    def pullback(
        self,
        by_landing: Float[Array, "wavelengths points 2"],
        by_weight: Float[Array, "wavelengths points"],
        parameters: Array,
        dot: Dots,
        colour: Colour,
        layout: Layout,
        scale: Scale,
    ) -> Float[Array, " parameters"]:
        """The derivative by all parameters, from that by landing points and weights."""
        cotangent = jnp.moveaxis(by_landing, -1, 0)
        by_mode = jnp.einsum("miwk,iwk->mw", mode_shapes_mm(self.u, layout), cotangent)
        by_mode = by_mode[..., None]
        by_colour = chromatic_shapes(by_mode, colour.chromatic, layout)
        states = state_shapes_mm(self.u, parameters, dot, layout, scale)
        seen = (parameters, dot, colour, layout, scale)
        by_coordinate = chromatic_slopes_mm(by_mode, *seen)[:, 0]
        by_u = jnp.einsum("wkij,wki->wkj", self.landed.slope_mm, by_landing)
        by_shape = [
            jnp.sum(by_colour, (1, 2)),
            jnp.einsum("siwk,iwk->s", states, cotangent),
            (colour.chromatic_slope @ by_coordinate)[None],
            *self.to_pupil_parameters((by_u, by_weight)),
        ]
        return jnp.concatenate(by_shape) @ shape_jacobian(dot, layout, scale)


def spot_and_pullback(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
    count: int,
) -> tuple[Spot, Callable[[Spot], Float[Array, " parameters"]]]:
    """Where rays of one dot (a row of `Dots`) land in one channel.

    Parameters
    ----------
    count : Of rays, a multiple of the number of wavelengths.

    Returns
    -------
    The spot, and its pullback: from a derivative by the spot to one by the parameters.
    """
    wavelengths = len(colour.chromatic)

    def opened(pupil_parameters: Array) -> tuple[tuple[Array, Array], PupilNodes]:
        nodes = nodes_of(pupil_parameters, dot, layout, scale, count)
        return (
            split_by_wavelength(nodes.u, wavelengths),
            split_by_wavelength(nodes.weight, wavelengths),
        ), nodes

    (u, weight), to_pupil_parameters, nodes = jax.vjp(
        opened, parameters[layout.pupil_parameters], has_aux=True
    )
    seen = (parameters, dot, colour, layout, scale)
    rays = PupilRays(u, landed_of(u, *seen), to_pupil_parameters)
    landed = rays.landed
    light = landed.light / jnp.sum(weight * landed.light)

    def pullback(by_spot: Spot) -> Array:
        by_landing = by_spot.landing_mm.reshape(landed.at_mm.shape)
        by_weight = by_spot.weight.reshape(weight.shape) * light
        found = rays.pullback(by_landing, by_weight, *seen)
        # Rays of the spot land from green's chief ray, not from their wavelength's own.
        by_width = jnp.einsum("wi,wki->", colour.lateral_slope_mm, by_landing)
        return found.at[layout.blocks["band_width"]].add(by_width)

    spot = _with_ray_origins(
        spot_of(landed, nodes, colour.lateral_mm), dot, wavelengths
    )
    return spot, pullback


def rays_of(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
    count: int,
    pupil: OpenPupil,
    group: RayGroup = ALL_RAYS,
) -> Rays:
    """Rays of the Gauss-Newton matrix, evenly lit, with all their derivatives.

    Parameters
    ----------
    count : Of the rays of the group.
    pupil : `open_pupil_of` the dot, the same for all groups.
    """

    def filled(opening: Opening) -> PupilNodes:
        nodes = nodes_in(opening, count, group)
        # Each ray stands for the area that is its own among all groups' rays.
        own = nodes.area / jnp.asarray(group.count, nodes.area.dtype)
        return eqx.tree_at(lambda n: n.area, nodes, own)

    def change(slope: Opening) -> PupilNodes:
        return jax.jvp(filled, (pupil.opening,), (slope,))[1]

    nodes = filled(pupil.opening)
    widened = jax.vmap(change, in_axes=-1, out_axes=-1)(pupil.slopes)
    wavelengths = len(colour.chromatic)
    u, u_widened = (
        split_by_wavelength(nodes.u, wavelengths),
        split_by_wavelength(widened.u, wavelengths),
    )
    seen = (parameters, dot, colour, layout, scale)
    landed = landed_of(u, *seen)
    evenly_lit = landed._replace(light=jnp.ones_like(landed.light))
    by_mode = mode_shapes_mm(u, layout)
    moved = jnp.concatenate(
        [
            chromatic_shapes(by_mode, colour.chromatic, layout),
            state_shapes_mm(u, parameters, dot, layout, scale),
            band_width_shape_mm(by_mode, *seen),
            jnp.einsum("wkij,wkjo->oiwk", landed.slope_mm, u_widened),
        ]
    )
    spot = spot_of(evenly_lit, nodes, colour.lateral_mm)
    return Rays(
        _with_ray_origins(spot, dot, wavelengths),
        moved.reshape(len(moved), 2, count),
        split_by_wavelength(widened.weight, wavelengths).reshape(count, -1).T,
    )


def _with_ray_origins(spot: Spot, dot: Dots, wavelengths: int) -> Spot:
    """Every ray from its own point of the dot aperture, in the order of the rays."""
    count = len(spot.landing_mm)
    from_mm = split_by_wavelength(
        ray_origins_mm(dot.sampled_ellipse_mm, count), wavelengths
    ).reshape(count, 2)
    return eqx.tree_at(lambda s: s.landing_mm, spot, spot.landing_mm + from_mm)


def open_pupil_of(
    parameters: Float[Array, " parameters"], dot: Dots, layout: Layout, scale: Scale
) -> OpenPupil:
    """The pupil that the few rays of the Gauss-Newton matrix fill."""

    def opening(pupil_parameters: Array) -> Opening:
        seen = pupil_at_dot(pupil_parameters, dot, layout, scale)
        return opening_on_spokes(*seen, FEWEST_SPOKES, SHARPNESS, _turn_rad(dot))

    pupil_parameters = parameters[layout.pupil_parameters]
    return OpenPupil(opening(pupil_parameters), jax.jacfwd(opening)(pupil_parameters))


def nodes_of(
    pupil_parameters: Float[Array, " pupil"],
    dot: Dots,
    layout: Layout,
    scale: Scale,
    count: int,
) -> PupilNodes:
    """Rays that fill the pupil of this dot; parameters as `Layout.pupil_parameters`.

    No two dots' rays leave the same gaps: the errors of images made of few rays then
    average out over the dots, where one common pattern would bias all alike.
    """
    seen = pupil_at_dot(pupil_parameters, dot, layout, scale)
    return pupil_nodes(*seen, count, SHARPNESS, _turn_rad(dot))


def _turn_rad(dot: Dots) -> Array:
    """Pseudo-random, and always the same for a dot."""
    turns = dot.field_mm @ jnp.asarray(_TURNS_PER_MM, dot.field_mm.dtype)
    return 2 * jnp.pi * jnp.mod(turns, 1.0)


def pupil_at_dot(
    pupil_parameters: Array, dot: Dots, layout: Layout, scale: Scale
) -> tuple[Array, Array, Pupil]:
    """Field point in field radii, radius of the stop as set, and the pupil."""
    return (
        field_point(dot, scale),
        fitted_stop_radius(pupil_parameters, layout, dot.stop_radius, dot.stop),
        pupil_of(pupil_parameters, layout, dot.blades),
    )


def landed_of(
    u: Array,
    parameters: Array,
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
) -> Landed:
    """`landed_rays` of a dot."""
    aberration = aberration_of(
        parameters, layout, scale, dot.principal_distance_ratio, dot.focus
    )
    depth = ObjectShift(dot.slope, dot.pupil_per_sine_mm, dot.vergence, dot.reference)
    defocus = parameters[layout.blocks["defocus"]][dot.group]
    cylinder = None
    if dot.sections is not None:
        offset = parameters[layout.blocks["astigmatic_offset"]][dot.group]
        cylinder = cylinder_mm(defocus, offset, dot.sections)
    return landed_rays(
        u,
        dot.field_mm,
        aberration,
        defocus,
        colour.chromatic,
        depth,
        cylinder,
    )

"""Rays of one dot through one channel, and how every parameter moves them.

What a photograph shows of a lens is where rays land and how much light each carries.
The image is made of many rays, of which the gradient needs only sums (`spot_seen`). The
matrix that leads the way to the minimum needs the derivative of every ray by every
parameter (`rays_of`), of few rays. Both are closed forms for the wavefront, in
which landing points are linear (`shapes`); the handful of numbers of the opening, which
moves the rays that fill it, are left to JAX.

The place where a ray leaves the hole of the dot (`dot_aperture`) is given, and moves
it. The width of a ray's Gaussian (`kernel.spot`) is taken as it is in all derivatives:
it only stands for rays in between, and vanishes as rays get many. So is the light that
an area of the pupil carries (`optics.etendue`), which varies by a few percent.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.fitting.wavefront.dot_aperture import left_from_mm
from lensfit.fitting.wavefront.dots import Dots
from lensfit.fitting.wavefront.parameters import Layout, Scale, aberration_of, pupil_of
from lensfit.fitting.wavefront.shapes import (
    Colour,
    coloured,
    field_point,
    mode_shapes_mm,
    spread_of,
    state_shapes_mm,
)
from lensfit.kernel.spot import Landed, Spot, dealt, landed_rays, spot_of
from lensfit.optics.depth import ObjectShift
from lensfit.optics.pupil import Pupil, PupilNodes, pupil_nodes
from lensfit.optics.sections import cylinder_mm

_TURNS_PER_MM = 12.9898, 78.233
"""Of a spiral, over the field: so many that neighbours have nothing in common."""
SHARPNESS = 64.0
"""Of the opening's corners: enough for pixels, and steadier than what a kernel uses."""


class Rays(NamedTuple):
    """Where the rays of a dot land, and the derivatives by shapes (`shapes`).

    `shapes.spread_of` leads from those to the parameters.

    Attributes
    ----------
    spot : Landing points from where the chief ray lands, weights and widths.
    moved_mm : d landing / d shape, x and y.
    brightened : d weight / d shape, of the last shapes, those of the opening.
    """

    spot: Spot
    moved_mm: Float[Array, "shapes 2 rays"]
    brightened: Float[Array, "opening rays"]


class Through(NamedTuple):
    """Rays through points of the opening, and what leads derivatives back.

    Attributes
    ----------
    u : Where they go through.
    landed : Where they land.
    to_opening : From derivatives by u and by the weight of its rays to one by the
        numbers of the opening.
    """

    u: Float[Array, "wavelengths points 2"]
    landed: Landed
    to_opening: Callable[[tuple[Array, Array]], tuple[Array]]

    def led_back(
        self,
        by_landing: Float[Array, "wavelengths points 2"],
        by_weight: Float[Array, "wavelengths points"],
        parameters: Array,
        dot: Dots,
        colour: Colour,
        layout: Layout,
        scale: Scale,
    ) -> Float[Array, " parameters"]:
        """A derivative by landing points and weights as one by all parameters."""
        pulled = jnp.moveaxis(by_landing, -1, 0)
        by_mode = jnp.einsum("miwk,iwk->mw", mode_shapes_mm(self.u, layout), pulled)
        by_colour = coloured(by_mode[..., None], colour.chromatic, layout)
        states = state_shapes_mm(self.u, parameters, dot, layout, scale)
        by_u = jnp.einsum("wkij,wki->wkj", self.landed.slope_mm, by_landing)
        by_shape = [
            jnp.sum(by_colour, (1, 2)),
            jnp.einsum("siwk,iwk->s", states, pulled),
            *self.to_opening((by_u, by_weight)),
        ]
        return jnp.concatenate(by_shape) @ spread_of(dot, layout, scale)


def spot_seen(
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
    The spot, and what leads a derivative by the spot back to one by the parameters.
    """
    wavelengths = len(colour.chromatic)

    def opened(opening: Array) -> tuple[tuple[Array, Array], PupilNodes]:
        nodes = nodes_of(opening, dot, layout, scale, count)
        return (dealt(nodes.u, wavelengths), dealt(nodes.weight, wavelengths)), nodes

    (u, weight), to_opening, nodes = jax.vjp(
        opened, parameters[layout.opening], has_aux=True
    )
    seen = (parameters, dot, colour, layout, scale)
    rays = Through(u, landed_of(u, *seen), to_opening)
    landed = rays.landed
    light = landed.light / jnp.sum(weight * landed.light)

    def led_back(by_spot: Spot) -> Array:
        by_landing = by_spot.landing_mm.reshape(landed.at_mm.shape)
        by_weight = by_spot.weight.reshape(weight.shape) * light
        return rays.led_back(by_landing, by_weight, *seen)

    spot = _from_hole(spot_of(landed, nodes, colour.lateral_mm), dot, wavelengths)
    return spot, led_back


def rays_of(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
    count: int,
) -> Rays:
    """Rays that lead the way, evenly lit, with all their derivatives."""
    opening = parameters[layout.opening]
    nodes = nodes_of(opening, dot, layout, scale, count)
    widened = jax.jacfwd(nodes_of)(opening, dot, layout, scale, count)
    wavelengths = len(colour.chromatic)
    u, u_widened = dealt(nodes.u, wavelengths), dealt(widened.u, wavelengths)
    landed = landed_of(u, parameters, dot, colour, layout, scale)
    evenly_lit = landed._replace(light=jnp.ones_like(landed.light))
    moved = jnp.concatenate(
        [
            coloured(mode_shapes_mm(u, layout), colour.chromatic, layout),
            state_shapes_mm(u, parameters, dot, layout, scale),
            jnp.einsum("wkij,wkjo->oiwk", landed.slope_mm, u_widened),
        ]
    )
    spot = spot_of(evenly_lit, nodes, colour.lateral_mm)
    return Rays(
        _from_hole(spot, dot, wavelengths),
        moved.reshape(len(moved), 2, count),
        dealt(widened.weight, wavelengths).reshape(count, -1).T,
    )


def _from_hole(spot: Spot, dot: Dots, wavelengths: int) -> Spot:
    """Every ray from a place of its own in the dot's hole, dealt as rays are."""
    count = len(spot.landing_mm)
    from_mm = dealt(left_from_mm(dot.filled_mm, count), wavelengths).reshape(count, 2)
    return eqx.tree_at(lambda s: s.landing_mm, spot, spot.landing_mm + from_mm)


def nodes_of(
    opening: Float[Array, " opening"],
    dot: Dots,
    layout: Layout,
    scale: Scale,
    count: int,
) -> PupilNodes:
    """Rays that fill the opening as this dot sees it; `opening` as `Layout.opening`.

    No two dots' rays leave the same gaps: what an image lacks for being made of few
    rays then averages out over the dots, where one pattern would lead all astray.
    """
    seen = opening_seen(opening, dot, layout, scale)
    return pupil_nodes(*seen, count, SHARPNESS, _turn_rad(dot))


def _turn_rad(dot: Dots) -> Array:
    """As good as random, and always the same for a dot."""
    turns = dot.field_mm @ jnp.asarray(_TURNS_PER_MM, dot.field_mm.dtype)
    return 2 * jnp.pi * jnp.mod(turns, 1.0)


def opening_seen(
    opening: Array, dot: Dots, layout: Layout, scale: Scale
) -> tuple[Array, Array, Pupil]:
    """Field point in field radii, radius of the stop as set, rims and stop."""
    ratios = opening[opening.shape[0] - layout.stops :]
    all_stops = jnp.concatenate([jnp.zeros(1, opening.dtype), ratios])
    radius = dot.stop_radius * jnp.exp(all_stops[dot.stop])
    return field_point(dot, scale), radius, pupil_of(opening, layout, dot.blades)


def landed_of(
    u: Array,
    parameters: Array,
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
) -> Landed:
    """`landed_rays` of a dot."""
    aberration = aberration_of(parameters, layout, scale, dot.magnified)
    depth = ObjectShift(dot.slope, dot.pupil_per_sine_mm, dot.vergence, dot.reference)
    defocus = parameters[layout.blocks["defocus"]][dot.group]
    cylinder = None
    if dot.sections is not None:
        beyond = parameters[layout.blocks["beyond"]][dot.group]
        cylinder = cylinder_mm(defocus, beyond, dot.sections)
    return landed_rays(
        u,
        dot.field_mm,
        aberration,
        defocus,
        colour.chromatic,
        depth,
        cylinder,
    )

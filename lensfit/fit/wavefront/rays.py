"""Rays of one dot through one channel, and how every parameter moves them.

What a photograph shows of a lens is where rays land and how much light each carries.
The image is made of many rays, of which the gradient needs only sums (`spot_seen`). The
matrix that leads the way to the minimum needs the derivative of every ray by every
parameter (`rays_of`), of few rays. Both are closed forms for the wavefront, in which
landing points are linear; the handful of numbers of the opening, which moves the rays
that fill it, are left to JAX.

The width of a ray's Gaussian (`kernel.spot`) is taken as it is in all derivatives: it
only stands for rays in between, and vanishes as rays get many. So is the light that an
area of the pupil carries (`optics.etendue`), which varies by a few percent.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.fit.wavefront.dots import Dots
from lensfit.fit.wavefront.parameters import Layout, Scale, aberration_of, pupil_of
from lensfit.kernel.spot import Landed, Spot, dealt, landed_rays, spot_of
from lensfit.optics.aberration import chief_sine, defocus_slope
from lensfit.optics.depth import ObjectShift
from lensfit.optics.modes import mode_gradients
from lensfit.optics.pupil import Pupil, PupilNodes, polar_nodes, pupil_nodes
from lensfit.optics.sections import cylinder_mm
from lensfit.optics.terms import Term, modes_of, term_amplitudes

_MM_PER_UM = 1e-3
_RINGS_AND_SPOKES = 6, 48
"""Of the rays that tell a centroid."""
_TURNS_PER_MM = 12.9898, 78.233
"""Of a spiral, over the field: so many that neighbours have nothing in common."""
_SHARPNESS = 64.0
"""Of the opening's corners: enough for pixels, and steadier than what a kernel uses."""


class Rays(NamedTuple):
    """Where the rays of a dot land, and the derivatives with respect to all parameters.

    Attributes
    ----------
    spot : Landing points from where the chief ray lands, weights and widths.
    moved_mm : d landing / d parameter.
    brightened : d weight / d parameter, of the parameters of the opening
        (`Layout.opening`).
    """

    spot: Spot
    moved_mm: Float[Array, "rays 2 parameters"]
    brightened: Float[Array, "rays opening"]


class Colour(NamedTuple):
    """The wavelengths of one channel, of equal weight.

    Attributes
    ----------
    chromatic : Chromatic coordinates (`optics.spectrum`).
    lateral_mm : Displacement of each wavelength's chief ray about their mean.
    """

    chromatic: Float[Array, " wavelengths"]
    lateral_mm: Float[Array, "wavelengths 2"]


def spot_seen(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
    count: int,
    *,
    evenly_lit: bool = False,
) -> tuple[Spot, Callable[[Spot], Float[Array, " parameters"]]]:
    """Where rays of one dot (a row of `Dots`) land in one channel.

    Parameters
    ----------
    count : Of rays, a multiple of the number of wavelengths.
    evenly_lit : As for `kernel.spot.landed_rays`.

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
    landed = _landed(u, parameters, dot, colour, layout, scale, evenly_lit)
    light = landed.light / jnp.sum(weight * landed.light)

    def led_back(by_spot: Spot) -> Array:
        by_landing = by_spot.landing_mm.reshape(landed.at_mm.shape)
        by_u = jnp.einsum("wkij,wki->wkj", landed.slope_mm, by_landing)
        by_weight = by_spot.weight.reshape(weight.shape) * light
        by_state = _moved_by_state(u, parameters, dot, layout, scale)
        return jnp.concatenate(
            [
                _terms_pulled(u, by_landing, dot, colour, layout, scale),
                jnp.einsum("wkip,wki->p", by_state, by_landing),
                *to_opening((by_u, by_weight)),
            ]
        )

    return spot_of(landed, nodes, colour.lateral_mm), led_back


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
    landed = _landed(u, parameters, dot, colour, layout, scale, evenly_lit=True)
    moved = [
        _moved_by_terms(u, dot, colour, layout, scale),
        _moved_by_state(u, parameters, dot, layout, scale),
        jnp.einsum("wkij,wkjp->wkip", landed.slope_mm, u_widened),
    ]
    return Rays(
        spot_of(landed, nodes, colour.lateral_mm),
        jnp.concatenate(moved, axis=-1).reshape(-1, 2, layout.size),
        dealt(widened.weight, wavelengths).reshape(count, -1),
    )


def centroids_mm(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    chromatic: Float[Array, "3 wavelengths"],
    layout: Layout,
    scale: Scale,
) -> Float[Array, "3 2"]:
    """Centroid of each channel's light from where the chief ray lands."""

    def channel(chromatic, lateral_mm):
        landing, weight = polar_landings(
            parameters,
            dot,
            Colour(chromatic, lateral_mm),
            layout,
            scale,
            _RINGS_AND_SPOKES,
        )
        return jnp.einsum("wk,wki->i", weight, landing)

    return jax.vmap(channel)(chromatic, dot.lateral_mm)


def polar_landings(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
    rings_and_spokes: tuple[int, int],
) -> tuple[Float[Array, "wavelengths rays 2"], Float[Array, "wavelengths rays"]]:
    """Where rays on rings and spokes land, from the chief ray of their wavelength, and
    the light of each, 1 in all; see `optics.pupil.polar_nodes`."""
    seen = _opening_seen(parameters[layout.opening], dot, layout, scale)
    nodes = polar_nodes(*seen, *rings_and_spokes, _SHARPNESS)
    u = jnp.broadcast_to(nodes.u[None], (len(colour.chromatic), *nodes.u.shape))
    landed = _landed(u, parameters, dot, colour, layout, scale)
    light = nodes.weight[None] * landed.light
    return landed.at_mm, light / jnp.sum(light)


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
    seen = _opening_seen(opening, dot, layout, scale)
    return pupil_nodes(*seen, count, _SHARPNESS, _turn_rad(dot))


def _turn_rad(dot: Dots) -> Array:
    """As good as random, and always the same for a dot."""
    turns = dot.field_mm @ jnp.asarray(_TURNS_PER_MM, dot.field_mm.dtype)
    return 2 * jnp.pi * jnp.mod(turns, 1.0)


def _opening_seen(
    opening: Array, dot: Dots, layout: Layout, scale: Scale
) -> tuple[Array, Array, Pupil]:
    """Field point in field radii, radius of the stop as set, rims and stop."""
    ratios = opening[opening.shape[0] - layout.stops :]
    all_stops = jnp.concatenate([jnp.zeros(1, opening.dtype), ratios])
    radius = dot.stop_radius * jnp.exp(all_stops[dot.stop])
    return _field_point(dot, scale), radius, pupil_of(opening, layout, dot.blades)


def _field_point(dot: Dots, scale: Scale) -> Array:
    """In field radii of the dot's state."""
    return dot.field_mm / (scale.field_radius_mm * dot.magnified)


def _landed(
    u: Array,
    parameters: Array,
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
    evenly_lit: bool = False,
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
        evenly_lit=evenly_lit,
    )


def _of_rays(function: Callable) -> Callable:
    """Of an array (wavelengths, points, 2) in place of one ray's; the rest is one."""
    return jax.vmap(jax.vmap(function, (0, None)), (0, None))


def _moved_by_terms(
    u: Array, dot: Dots, colour: Colour, layout: Layout, scale: Scale
) -> Array:
    """d landing / d coefficients and colour: (wavelengths, points, 2, parameters)."""
    h = _field_point(dot, scale)

    def moved(terms: tuple[Term, ...]) -> Array:
        row, pair = term_amplitudes(h, terms)
        shapes = _of_rays(mode_gradients)(u, modes_of(terms))[:, :, row]
        return jnp.einsum("wktci,tc->wkit", shapes, pair) * _MM_PER_UM

    chromatic = colour.chromatic[:, None, None, None]
    linear = moved(layout.colour_terms) * chromatic
    return jnp.concatenate([moved(layout.terms), linear, linear * chromatic], axis=-1)


def _terms_pulled(
    u: Array, by_landing: Array, dot: Dots, colour: Colour, layout: Layout, scale: Scale
) -> Array:
    """Sum over the rays of `by_landing` times `_moved_by_terms`."""
    h = _field_point(dot, scale)

    def pulled(terms: tuple[Term, ...]) -> Array:
        """Of each wavelength."""
        row, pair = term_amplitudes(h, terms)
        shapes = _of_rays(mode_gradients)(u, modes_of(terms))
        by_mode = jnp.einsum("wkmci,wki->wmc", shapes, by_landing)
        return jnp.einsum("wtc,tc->wt", by_mode[:, row], pair) * _MM_PER_UM

    linear = pulled(layout.colour_terms) * colour.chromatic[:, None]
    quadratic = linear * colour.chromatic[:, None]
    every = [pulled(layout.terms), linear, quadratic]
    return jnp.concatenate([jnp.sum(part, 0) for part in every])


def _moved_by_state(
    u: Array, parameters: Array, dot: Dots, layout: Layout, scale: Scale
) -> Array:
    """d landing / d defocus, beyond and exit pupil: (wavelengths, points, 2, ...)."""
    defocus = parameters[layout.blocks["defocus"]][dot.group]
    p = u * scale.reference_sine
    where = layout.blocks["exit_pupil"]

    def chief(exit_pupil):
        changed = parameters.at[where].set(exit_pupil)
        aberration = aberration_of(changed, layout, scale, dot.magnified)
        return chief_sine(dot.field_mm, aberration)

    here = chief(parameters[where])
    turned = jax.jacfwd(chief)(parameters[where])
    by_chief = defocus * _of_rays(jax.jacfwd(defocus_slope, 1))(p, here)
    mine = jax.nn.one_hot(dot.group, layout.groups, dtype=u.dtype)
    by_group = _of_rays(defocus_slope)(p, here)[..., None] * mine[None, None, None]
    parts = [by_group, by_chief @ turned]
    if dot.sections is not None:
        alone = p @ cylinder_mm(jnp.zeros(()), jnp.ones(()), dot.sections)
        by_beyond = alone[..., None] * mine[None, None, None]
        parts[0] = by_group + dot.sections.per_defocus * by_beyond
        parts.insert(1, by_beyond)
    return jnp.concatenate(parts, axis=-1)

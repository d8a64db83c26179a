"""Centroid of the light of a small dot, from where its chief ray lands.

Few rays are enough: on rings and spokes, the same for every wavelength.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.fitting.wavefront.dot_arrays import Dots
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.rays import (
    SHARPNESS,
    PupilRays,
    landed_of,
    pupil_at_dot,
)
from lensfit.fitting.wavefront.shapes import Colour, colours_of
from lensfit.optics.pupil_nodes import polar_nodes

_RINGS_AND_SPOKES = 6, 48
"""Of the rays that a centroid is computed from."""


def centroids_mm(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    wavelengths_nm: Float[Array, "3 wavelengths"],
    layout: Layout,
    scale: Scale,
) -> Float[Array, "3 2"]:
    """Centroid of each channel's light from where the chief ray lands."""

    def channel(colour: Colour) -> Array:
        seen = (parameters, dot, colour, layout, scale)
        landing, weight = polar_landings(*seen, _RINGS_AND_SPOKES)
        return jnp.einsum("wk,wki->i", weight, landing)

    return jax.vmap(channel)(colours_of(parameters, dot, wavelengths_nm, layout))


def centroid_slopes_mm(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    wavelengths_nm: Float[Array, "3 wavelengths"],
    layout: Layout,
    scale: Scale,
) -> Float[Array, "3 2 parameters"]:
    """d `centroids_mm` / d parameter, the light that an area carries held constant."""

    def channel(colour: Colour) -> Array:
        wavelengths = len(colour.chromatic)

        def opened(pupil_parameters: Array) -> tuple[Array, Array]:
            return _polar(pupil_parameters, dot, wavelengths, layout, scale)

        (u, weight), to_pupil_parameters = jax.vjp(
            opened, parameters[layout.pupil_parameters]
        )
        seen = (parameters, dot, colour, layout, scale)
        landed = landed_of(u, *seen)
        rays = PupilRays(u, landed, to_pupil_parameters)
        light = landed.light / jnp.sum(weight * landed.light)
        share = (weight * light)[..., None]
        off = landed.at_mm - jnp.sum(share * landed.at_mm, (0, 1), keepdims=True)

        def along(axis: Array) -> Array:
            by_landing = share * axis[None, None]
            return rays.pullback(by_landing, light * (off @ axis), *seen)

        return jax.vmap(along)(jnp.eye(2, dtype=u.dtype))

    return jax.vmap(channel)(colours_of(parameters, dot, wavelengths_nm, layout))


def polar_landings(
    parameters: Float[Array, " parameters"],
    dot: Dots,
    colour: Colour,
    layout: Layout,
    scale: Scale,
    rings_and_spokes: tuple[int, int],
) -> tuple[Float[Array, "wavelengths rays 2"], Float[Array, "wavelengths rays"]]:
    """Where rays on rings and spokes land, from the chief ray of their wavelength, and
    the light of each, 1 in all; see `optics.pupil_nodes.polar_nodes`."""
    pupil_parameters, wavelengths = (
        parameters[layout.pupil_parameters],
        len(colour.chromatic),
    )
    u, weight = _polar(
        pupil_parameters, dot, wavelengths, layout, scale, rings_and_spokes
    )
    landed = landed_of(u, parameters, dot, colour, layout, scale)
    light = weight * landed.light
    return landed.at_mm, light / jnp.sum(light)


def _polar(
    pupil_parameters: Array,
    dot: Dots,
    wavelengths: int,
    layout: Layout,
    scale: Scale,
    rings_and_spokes: tuple[int, int] = _RINGS_AND_SPOKES,
) -> tuple[Float[Array, "wavelengths rays 2"], Float[Array, "wavelengths rays"]]:
    """Points of the pupil, the same for every wavelength, and their weights."""
    seen = pupil_at_dot(pupil_parameters, dot, layout, scale)
    nodes = polar_nodes(*seen, *rings_and_spokes, SHARPNESS)
    u = jnp.broadcast_to(nodes.u[None], (wavelengths, *nodes.u.shape))
    return u, jnp.broadcast_to(nodes.weight[None], u.shape[:2])

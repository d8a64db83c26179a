"""How rays go by every parameter, from how they go by the shapes that they share."""

from typing import NamedTuple

import jax.numpy as jnp

from lensfit.fitting.wavefront.shapes import spread_of


class Moves(NamedTuple):
    """Last axis: parameters."""

    spot: object
    moved_mm: jnp.ndarray
    brightened: jnp.ndarray


def by_parameters(rays, dot, layout, scale) -> Moves:
    """Of `rays.Rays` before a dot."""
    spread = spread_of(dot, layout, scale)
    of_opening = spread[len(spread) - len(rays.brightened) :]
    return Moves(
        rays.spot,
        jnp.einsum("sir,sp->rip", rays.moved_mm, spread),
        jnp.einsum("or,op->rp", rays.brightened, of_opening)[:, layout.opening],
    )

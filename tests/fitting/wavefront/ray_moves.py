"""How rays go by every parameter, from how they go by the shapes that they share; and
rays as the group that a matrix is made of."""

from typing import NamedTuple

import jax.numpy as jnp

from lensfit.fitting.wavefront.rays import open_pupil_of, rays_of
from lensfit.fitting.wavefront.shapes import shape_jacobian


class Moves(NamedTuple):
    """Last axis: parameters."""

    spot: object
    landing_slopes_mm: jnp.ndarray
    weight_slopes: jnp.ndarray


def by_parameters(rays, dot, layout, scale) -> Moves:
    """Of `rays.Rays` before a dot."""
    jacobian = shape_jacobian(dot, layout, scale)
    of_opening = jacobian[len(jacobian) - len(rays.weight_slopes) :]
    return Moves(
        rays.spot,
        jnp.einsum("sir,sp->rip", rays.landing_slopes_mm, jacobian),
        jnp.einsum("or,op->rp", rays.weight_slopes, of_opening)[
            :, layout.pupil_parameters
        ],
    )


def rays_alone(parameters, dot, colour, layout, scale, count):
    """All rays of a dot, in one group."""
    pupil = open_pupil_of(parameters, dot, layout, scale)
    return rays_of(parameters, dot, colour, layout, scale, count, pupil)


def only_group(rays):
    """These rays as the only group that a Gauss-Newton matrix is made of."""
    return (lambda index: rays), jnp.asarray(1)

"""The ideal projection that distortion is measured from: field angle to image radius.

A lens images the direction (X, Y, Z) (x right, y down, z from the lens into the scene)
at an azimuth that it keeps and at a radius that depends on the field angle theta alone.
In units of the principal distance the radius is tan(theta) for a rectilinear lens,
2 tan(theta/2) for a stereographic one and theta for an equidistant one. Wide lenses
need less distortion on top when the base is nearer to what they do.

Every function takes one point; callers map it over many with `jax.vmap`.

Reference: R. Kingslake, Optical System Design (1983), on fisheye projections.
"""

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Float

BaseProjection = Literal["rectilinear", "stereographic", "equidistant"]
BASE_PROJECTIONS: tuple[BaseProjection, ...] = (
    "rectilinear",
    "stereographic",
    "equidistant",
)


def image_of_direction(
    direction: Float[Array, "3"], base: BaseProjection
) -> Float[Array, "2"]:
    """Image position, in principal distances, of directions in front of the lens.

    Parameters
    ----------
    direction : (X, Y, Z), any length; Z > 0 is required by the rectilinear base,
        the others also see behind the entrance pupil (NaN where they do not).
    base : Which ideal projection.
    """
    side, ahead = direction[:2], direction[2]
    if base == "rectilinear":
        return side / jnp.where(ahead > 0, ahead, jnp.nan)
    squared = jnp.sum(side**2)
    if base == "stereographic":
        return 2 * side / _ahead_plus_length(squared, ahead)
    return side * _angle_over_sine_side(squared, ahead)


def image_of_undistorted(
    undistorted: Float[Array, "2"], base: BaseProjection
) -> Float[Array, "2"]:
    """`image_of_direction` for points of the rectilinear image plane at distance 1."""
    ahead = jnp.ones_like(undistorted[:1])
    return image_of_direction(jnp.concatenate([undistorted, ahead]), base)


def undistorted_of_image(
    image: Float[Array, "2"], base: BaseProjection
) -> Float[Array, "2"]:
    """Inverse of `image_of_undistorted`; NaN at and beyond 90 degrees off axis."""
    if base == "rectilinear":
        return image
    squared = jnp.sum(image**2)
    if base == "stereographic":
        quarter = squared / 4
        return image / jnp.where(quarter < 1, 1 - quarter, jnp.nan)
    inside = squared < (jnp.pi / 2) ** 2
    angle_squared = jnp.where(inside, squared, 1.0)
    small = angle_squared < 1e-8
    angle = jnp.sqrt(jnp.where(small, 1.0, angle_squared))
    ratio = jnp.where(small, 1 + angle_squared / 3, jnp.tan(angle) / angle)
    return image * jnp.where(inside, ratio, jnp.nan)


def _ahead_plus_length(squared: Array, ahead: Array) -> Array:
    """Z + |(X, Y, Z)|, which behind the lens is no difference of near equals."""
    length = jnp.sqrt(squared + ahead**2)
    behind = ahead < 0
    return jnp.where(
        behind, squared / jnp.where(behind, length - ahead, 1.0), ahead + length
    )


def _angle_over_sine_side(squared: Array, ahead: Array) -> Array:
    """theta / |side|, smooth through the axis (series where the angle is tiny)."""
    small = (squared < 1e-12 * ahead**2) & (ahead > 0)
    side = jnp.sqrt(jnp.where(small, 1.0, squared))
    near_axis = 1 / jnp.where(ahead > 0, ahead, jnp.nan)
    return jnp.where(small, near_axis, jnp.arctan2(side, ahead) / side)

"""The ideal projection that distortion is measured from, and the pupil it is seen from.

A lens images the direction (X, Y, Z) (x right, y down, z from the lens into the scene)
at an azimuth that it keeps and at a radius that depends on the field angle theta alone.
In units of the principal distance the radius is tan(theta) for a rectilinear lens,
2 tan(theta/2) for a stereographic one and theta for an equidistant one. Wide lenses
need less distortion on top when the base is nearer to what they do.

Chief rays of a real lens do not meet in one point: the entrance pupil shifts along the
axis with field angle (spherical aberration of the pupil), to first order by `shift_mm`
sin^2 of the field angle. A chief-ray map that was measured on a flat chart holds at the
chart's distance; for nearer or farther objects the shifted pupil causes a parallax.
With z the distance of the object and z0 that of the chart, both from the pupil on the
axis, the map is evaluated for an object at the distance

    z - shift sin^2 (1 - z / z0).

Nothing changes at the chart's distance, nor on the axis.

Every function takes one point; callers map it over many with `jax.vmap`.

References: R. Kingslake, Optical System Design (1983), on fisheye projections; W. T.
Welford, Aberrations of Optical Systems (1986), on aberrations of the pupils.
"""

from typing import Literal, NamedTuple

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


class PupilShift(NamedTuple):
    """Shift of the entrance pupil with field angle.

    Attributes
    ----------
    shift_mm : Towards the scene, per squared sine of the field angle.
    chart_distance_mm : From the entrance pupil on the axis; there the map holds.
    """

    shift_mm: Float[Array, ""]
    chart_distance_mm: Float[Array, ""]


def equivalent_chart_point(
    point_mm: Float[Array, "3"], pupil_shift: PupilShift | None
) -> Float[Array, "3"]:
    """The point whose chief ray in the chart's map lands where that of `point_mm` does.

    Parameters
    ----------
    point_mm : From the entrance pupil on the axis: x right, y down, z ahead.
    pupil_shift : None for a pupil that does not shift.
    """
    if pupil_shift is None:
        return point_mm
    across = jnp.sum(point_mm[:2] ** 2)
    length = across + point_mm[2] ** 2
    sine2 = across / jnp.where(length > 0, length, 1.0)
    apart = 1 - point_mm[2] / pupil_shift.chart_distance_mm
    return point_mm.at[2].add(-pupil_shift.shift_mm * sine2 * apart)

"""Another depth through the same lens: what a change of object distance does to rays.

Moving the sensor is defocus in its exact form, but an object at another distance is
not: its light enters the lens otherwise curved. Seen from the entrance pupil, the path
from a point at distance z (slope t of its chief ray) to the pupil point rho is

    W(rho, z) = |rho - z (t, 1)| - (what is constant and linear in rho),

and the aberration function becomes E + W(rho, z_ref) - W(rho, z), first order in the
change, with no new parameter: rho follows from the chief-ray map x(q), q being the
direction cosines in the scene, since area in (x, p) is area in (q, rho) (etendue):

    rho = (dx/dq)' p = cos^-1 (I + t t') (dx/dt)' p.

A scale sqrt(c(z) / c(z_ref)), c the principal distance at each depth, makes the
paraxial part exact for any change.

Reference: H. A. Buchdahl, An Introduction to Hamiltonian Optics (1970), on the shift of
the object's plane.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.paraxial import FirstOrder


class ObjectShift(eqx.Module):
    """An object moved along its chief ray, away from where aberrations are known.

    Attributes
    ----------
    slope : t, tangents of the field angle in the scene, x right, y down.
    pupil_per_sine_mm : rho = this times p.
    vergence_per_mm, reference_per_mm : 1 / z and 1 / z_ref.
    """

    slope: Float[Array, "2"]
    pupil_per_sine_mm: Float[Array, "2 2"]
    vergence_per_mm: Float[Array, ""]
    reference_per_mm: Float[Array, ""]


def object_shift(
    slope: Float[Array, "2"],
    image_per_slope_mm: Float[Array, "2 2"],
    first_order: FirstOrder,
    reference_distance_mm: Float[Array, ""],
    object_distance_mm: Float[Array, ""],
) -> ObjectShift:
    """From the chief-ray map and the two distances (from the sensor; inf allowed).

    Parameters
    ----------
    slope : Tangents of the chief ray's angle in the scene.
    image_per_slope_mm : dx/dt of the chief-ray map at the reference distance,
        [i, j] = d x_i / d t_j.
    """
    pupil_mm = first_order.focal_length_mm / first_order.pupil_magnification
    offset = first_order.entrance_pupil_offset_mm
    vergence = 1 / (object_distance_mm - offset)
    reference = 1 / (reference_distance_mm - offset)
    scale = jnp.sqrt((1 - reference * pupil_mm) / (1 - vergence * pupil_mm))
    turned = jnp.eye(2, dtype=slope.dtype) + jnp.outer(slope, slope)
    secant = jnp.sqrt(1 + slope @ slope)
    return ObjectShift(
        slope, scale * secant * turned @ image_per_slope_mm.T, vergence, reference
    )


def shifted_path_mm(
    p_x: Float[Array, ""], p_y: Float[Array, ""], shift: ObjectShift
) -> Float[Array, ""]:
    """What the shift adds to E for a ray with direction cosines p, mm."""
    (a, b), (c, d) = shift.pupil_per_sine_mm
    rho = a * p_x + b * p_y, c * p_x + d * p_y
    before = _path(rho, shift.slope, shift.reference_per_mm)
    return before - _path(rho, shift.slope, shift.vergence_per_mm)


def _path(rho: tuple[Array, Array], slope: Array, vergence: Array) -> Array:
    """W, written so that an infinite distance is an ordinary value."""
    secant = jnp.sqrt(1 + slope[0] * slope[0] + slope[1] * slope[1])
    along = slope[0] * rho[0] + slope[1] * rho[1]
    square = rho[0] * rho[0] + rho[1] * rho[1]
    excess = vergence * square - 2 * along
    root = jnp.sqrt(1 + vergence * excess / secant**2)
    return excess / (secant * (1 + root)) + along / secant

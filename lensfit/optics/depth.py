"""Another depth, and cylinders: what changes of focus in the scene do to rays.

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

In an anamorphic lens x and y are focused each by itself, in two sections. First-order
optics holds in either with principal distances c_x and c_y of its own; the squeeze is s
= c_y / c_x. An object whose vergence differs by V from that of the focus is out of
focus by c_x^2 V along x and by c_y^2 V along y: its blur on the sensor is an oval of 1
: s^2, and of 1 : s once the picture is desqueezed. A lens that is sharp in both
sections at its focus distance keeps the ratio 1/s^2 of its defoci wherever it is
focused.

Moving the sensor, or the lens behind the cylinders, is the same defocus in both
sections, and counts as that of y. What x has beyond it is the work of a cylinder in
front: light of the slope t that passes the entrance pupil at rho gets path

    A rho_x^2 / (2 (1 + t_x^2) sqrt(1 + t t')),

a cylindrical wave of curvature A. With Z = A c_x^2, the same in millimetres of defocus
on the axis, and rho = M p, that is Z (w p)^2 / 2, w being nearly (1, 0).

References: H. A. Buchdahl, An Introduction to Hamiltonian Optics (1970), on the shift
of the object's plane; G. G. Slyusarev, Aberration and Optical Design Theory (1984), on
anamorphic systems as two systems of one axis.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.distortion import Distortion
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


class Sections(eqx.Module):
    """How the section along x differs from that along y, for one field point.

    Attributes
    ----------
    axis : w of the module docstring.
    per_defocus : Defocus that x has beyond y, per defocus of y, where both are sharp at
        the focus distance: 1/s^2 - 1.
    """

    axis: Float[Array, "2"]
    per_defocus: Float[Array, ""]


def log_squeeze(distortion: Distortion) -> Float[Array, ""]:
    """ln(c_y / c_x); 0 for a spherical lens."""
    return distortion.squeeze[0]


def sections_of(
    depth: ObjectShift,
    principal_distance_mm: Float[Array, ""],
    squeeze_log: Float[Array, ""],
) -> Sections:
    """The sections of a lens, at the field point of `depth`.

    Parameters
    ----------
    principal_distance_mm : Geometric mean of both sections, for which M was made.
    squeeze_log : As `log_squeeze`.
    """
    along_x_mm = principal_distance_mm * jnp.exp(-squeeze_log / 2)
    t = depth.slope
    seen = jnp.sqrt((1 + t[0] ** 2) * jnp.sqrt(1 + t @ t))
    axis = depth.pupil_per_sine_mm[0] / (along_x_mm * seen)
    return Sections(axis, jnp.exp(-2 * squeeze_log) - 1)


def cylinder_mm(
    defocus_mm: Float[Array, ""], beyond_mm: Float[Array, ""], sections: Sections
) -> Float[Array, "2 2"]:
    """What the x section has beyond the sensor's defocus: d landing / d p, mm.

    Parameters
    ----------
    defocus_mm : Of the y section.
    beyond_mm : Of the x section, beyond what makes both sharp at one distance.
    """
    size = beyond_mm + sections.per_defocus * defocus_mm
    return size * jnp.outer(sections.axis, sections.axis)

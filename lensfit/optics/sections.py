"""The two sections of an anamorphic lens: x and y are focused each by itself.

First-order optics holds in either section with principal distances c_x and c_y of its
own; the squeeze is s = c_y / c_x. An object whose vergence differs by V from that of
the focus is out of focus by c_x^2 V along x and by c_y^2 V along y: its blur on the
sensor is an oval of 1 : s^2, and of 1 : s once the picture is desqueezed. A lens that
is sharp in both sections at its focus distance keeps the ratio 1/s^2 of its defoci
wherever it is focused.

Moving the sensor, or the lens behind the cylinders, is the same defocus in both
sections, and counts as that of y. What x has beyond it is the work of a cylinder in
front: light of the slope t that passes the entrance pupil at rho (`depth`) gets path

    A rho_x^2 / (2 (1 + t_x^2) sqrt(1 + t t')),

a cylindrical wave of curvature A. With Z = A c_x^2, the same in millimetres of defocus
on the axis, and rho = M p, that is Z (w p)^2 / 2, w being nearly (1, 0).

Reference: G. G. Slyusarev, Aberration and Optical Design Theory (1984), on anamorphic
systems as two systems of one axis.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.depth import ObjectShift
from lensfit.optics.distortion import Distortion


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

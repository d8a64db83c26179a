"""First-order optics of a lens state: how focus, depth and stop set defocus and pupil.

All follows from focal length f, pupil magnification m_p (exit over entrance pupil) and
the place of the entrance pupil, without further parameters. With X the distance of an
object in front of the front focal point, Newton's equation puts its image f^2 / X
behind the rear focal point, at magnification m = -f / X. The entrance pupil lies
f / m_p behind the front focal point, the exit pupil m_p f before the rear one, so that
for an object at distance z from the entrance pupil

    X = z - f / m_p,
    distance from exit pupil to image  L = m_p f + f^2 / X,
    principal distance (image height over tan of the field angle)  c = f z / X,
    direction cosine at the pupil's rim  1 / (2 N (1 - m / m_p)).

Distances to the scene count from the sensor plane, as on the barrel; infinity is
allowed. Scalars; callers map over many with `jax.vmap`.

Reference: W. J. Smith, Modern Optical Engineering, on first-order layout and pupils.
"""

import equinox as eqx
from jaxtyping import Array, Float

Scalar = Float[Array, ""]


class FirstOrder(eqx.Module):
    """Cardinal data of a lens at one focus setting.

    Attributes
    ----------
    focal_length_mm : f.
    pupil_magnification : m_p, exit pupil over entrance pupil.
    entrance_pupil_offset_mm : Entrance pupil in front of the sensor plane.
    """

    focal_length_mm: Scalar
    pupil_magnification: Scalar
    entrance_pupil_offset_mm: Scalar


def first_order_of(
    principal_distance_mm: Scalar,
    pupil_magnification: Scalar,
    entrance_pupil_offset_mm: Scalar,
    focus_distance_mm: Scalar,
) -> FirstOrder:
    """The lens whose chief rays have this principal distance when focused there."""
    inverse = 1 / (focus_distance_mm - entrance_pupil_offset_mm)
    c = principal_distance_mm
    f = c / (1 + c * inverse / pupil_magnification)
    return FirstOrder(f, pupil_magnification, entrance_pupil_offset_mm)


def image_shift_mm(first_order: FirstOrder, distance_mm: Scalar) -> Scalar:
    """f^2 / X: how far behind the rear focal point the image of a distance lies."""
    return first_order.focal_length_mm**2 * _vergence(first_order, distance_mm)


def defocus_mm(
    first_order: FirstOrder, focus_distance_mm: Scalar, object_distance_mm: Scalar
) -> Scalar:
    """How far the sensor lies behind the sharp image of an object.

    Positive for an object beyond the focus distance, negative for a nearer one.
    """
    return image_shift_mm(first_order, focus_distance_mm) - image_shift_mm(
        first_order, object_distance_mm
    )


def magnification(first_order: FirstOrder, distance_mm: Scalar) -> Scalar:
    """m, negative: image over object size at this distance."""
    return -first_order.focal_length_mm * _vergence(first_order, distance_mm)


def exit_pupil_distance_mm(first_order: FirstOrder, distance_mm: Scalar) -> Scalar:
    """From the exit pupil to the image of an object at this distance."""
    towards_focus = first_order.pupil_magnification * first_order.focal_length_mm
    return towards_focus + image_shift_mm(first_order, distance_mm)


def rim_sine(
    first_order: FirstOrder, f_number: Scalar, object_distance_mm: Scalar
) -> Scalar:
    """Direction cosine of the rays through the rim of the stop, on the axis.

    The f-number is that of the lens focused at infinity: f over the entrance pupil.
    """
    bellows = 1 - magnification(first_order, object_distance_mm) / (
        first_order.pupil_magnification
    )
    return 1 / (2 * f_number * bellows)


def _vergence(first_order: FirstOrder, distance_mm: Scalar) -> Array:
    """1 / X."""
    to_pupil = distance_mm - first_order.entrance_pupil_offset_mm
    pupil_mm = first_order.focal_length_mm / first_order.pupil_magnification
    return 1 / (to_pupil - pupil_mm)

"""Shift of the entrance pupil along the axis with field angle.

Chief rays of a real lens do not meet in one point: the entrance pupil shifts along the
axis with field angle (spherical aberration of the pupil), to first order by `shift_mm`
sin^2 of the field angle. A chief-ray map that was measured on a flat chart holds at the
chart's distance; for nearer or farther objects the shifted pupil causes a parallax.
With z the distance of the object and z0 that of the chart, both from the pupil on the
axis, the map is evaluated for an object at the distance

    z - shift sin^2 (1 - z / z0).

Nothing changes at the chart's distance, nor on the axis.

Reference: W. T. Welford, Aberrations of Optical Systems (1986), on aberrations of the
pupils.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


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

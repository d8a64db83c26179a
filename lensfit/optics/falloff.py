"""Relative illumination: how bright the picture is off axis, 1 on the axis.

Its negative logarithm is a Bernstein polynomial of the squared radius s (in units of
the largest squared radius it is stated for), with control values that rise from 0:

    -ln I(s) = sum_k b_k B_k,n(s),    0 = b_0 <= b_1 <= ... <= b_n,

so that I lies in (0, 1] and never rises outwards whatever the values are. (One in two
hundred published polynomials of lens databases goes negative in the corner.) Beyond
that radius the logarithm goes on with its last slope.

This is what the photographs show. At a wide aperture it holds natural, optical and
mechanical vignetting together, which is why it belongs to one f-number.
"""

import equinox as eqx
from jaxtyping import Array, Float

from lensfit.optics.bernstein import continued_bernstein


class Illumination(eqx.Module):
    """Fall-off of the three channels at one f-number.

    Attributes
    ----------
    control : b_1 ... b_n of red, green and blue.
    valid_radius_mm : Where s is 1: the farthest corner of the photographs, or
        somewhat beyond the outermost detection.
    """

    control: Float[Array, "3 terms"]
    valid_radius_mm: Float[Array, ""]


def log_loss(
    relative_squared_radius: Float[Array, ""], control: Float[Array, " terms"]
) -> Float[Array, ""]:
    """-ln I at s; `control` holds b_1 ... b_n."""
    return continued_bernstein(relative_squared_radius, control.shape[0]) @ control

"""Relative illumination: how bright the picture is off axis, 1 on the axis.

Its negative logarithm is a Bernstein polynomial of the squared radius s (in units of
the largest photographed squared radius), with control values that rise from 0:

    -ln I(s) = sum_k b_k B_k,n(s),    0 = b_0 <= b_1 <= ... <= b_n,

so that I lies in (0, 1] and never rises outwards whatever the values are. (One in two
hundred published polynomials of lens databases goes negative in the corner.) Beyond
the photographed radius the logarithm goes on with its last slope.

This is what the photographs show. At a wide aperture it holds natural, optical and
mechanical vignetting together, which is why it belongs to one f-number.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.bernstein import bernstein


class Illumination(eqx.Module):
    """Fall-off of the three channels at one f-number.

    Attributes
    ----------
    control : b_1 ... b_n of red, green and blue.
    valid_radius_mm : Largest photographed radius, where s is 1.
    """

    control: Float[Array, "3 terms"]
    valid_radius_mm: Float[Array, ""]


def log_loss(
    relative_squared_radius: Float[Array, ""], control: Float[Array, " terms"]
) -> Float[Array, ""]:
    """-ln I at s; `control` holds b_1 ... b_n."""
    s = relative_squared_radius
    inside = jnp.minimum(s, 1.0)
    value = bernstein(inside, control.shape[0]) @ control
    before = control[-2] if control.shape[0] > 1 else jnp.zeros((), control.dtype)
    slope = control.shape[0] * (control[-1] - before)
    return value + slope * jnp.maximum(s - 1.0, 0.0)

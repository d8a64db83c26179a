"""How much light a lens sends each way through its pupil.

A dot shines evenly into all directions, counted by their cosines in the scene. With
W(o, P) the mixed characteristic of the lens (o the object point, P the direction
cosines at the sensor) rays land at x = dW/dP and leave the object towards dW/do. So

    d(cosines in the scene) / dP = d^2 W / do dP = (dx / do at fixed P)':

an area of the pupil carries light in proportion to the determinant of how landing
points there follow the object. It is the same everywhere in the pupil for a lens
without coma, which obeys Abbe's sine condition all over the field; for a fast double
Gauss it varies by a few percent, and drags the light of a blurred dot by a seventh of a
pixel.

References: H. A. Buchdahl, An Introduction to Hamiltonian Optics (1970); W. T. Welford,
Aberrations of Optical Systems (1986), on the optical sine theorem.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.aberration import LocalWavefront, tangent_of
from lensfit.optics.modes import wavefront_gradient


def light_density(
    u: Float[Array, "2"], defocus_mm: Float[Array, ""], local: LocalWavefront
) -> Float[Array, ""]:
    """Light per area of u, up to a factor that all rays of a field point share.

    Parameters
    ----------
    u, defocus_mm : As for `aberration.landing_mm`.
    """

    # With x_c where the chief ray lands, x = x_c + landing(x_c, u), and a fixed
    # direction is a u that goes against the chief ray's. What defocus adds to that is
    # the same for every ray.
    def followed(u_per_mm: Array, series_per_mm: Array) -> Array:
        at, towards = (u, local.series_mm), (-u_per_mm, series_per_mm)
        return jax.jvp(wavefront_gradient, at, towards)[1]

    of_ray = jax.vmap(followed, -1, -1)(
        local.chief_per_mm / local.reference_sine, local.series_per_mm
    )
    of_all = jnp.eye(2, dtype=u.dtype) - defocus_mm * (
        jax.jacfwd(tangent_of)(local.chief_sine) @ local.chief_per_mm
    )
    a, b = of_all + of_ray
    return a[0] * b[1] - a[1] * b[0]

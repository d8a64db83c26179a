"""Light per area of the pupil (etendue), as a function of the pupil point.

A dot shines evenly into all directions, counted by their cosines in the scene. With
W(o, P) the mixed characteristic of the lens (o the object point, P the direction
cosines at the sensor) rays land at x = dW/dP and leave the object towards dW/do. So

    d(cosines in the scene) / dP = d^2 W / do dP = (dx / do at fixed P)':

an area of the pupil carries light in proportion to the determinant of how landing
points there follow the object. It is the same everywhere in the pupil for a lens
without coma, which obeys Abbe's sine condition all over the field; for a fast double
Gauss it varies by a few percent, and biases the centroid of a blurred dot by a seventh
of a pixel.

References: H. A. Buchdahl, An Introduction to Hamiltonian Optics (1970); W. T. Welford,
Aberrations of Optical Systems (1986), on the optical sine theorem.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.aberration import LocalWavefront, tangent_of
from lensfit.optics.modes import wavefront_slopes


def light_density(
    u: Float[Array, "2"], defocus_mm: Float[Array, ""], local: LocalWavefront
) -> Float[Array, ""]:
    """Light per area of u, up to a factor that all rays of a field point share.

    Parameters
    ----------
    u, defocus_mm : As for `aberration.landing_and_jacobian_mm`.
    """

    # With x_c where the chief ray lands, x = x_c + landing(x_c, u), and a fixed
    # direction is a u that goes against the chief ray's. What defocus adds to that is
    # the same for every ray. By components, as `modes.wavefront_slopes`.
    _, per_u = wavefront_slopes(u, local.series_mm, local.powers)
    per_mm = [
        wavefront_slopes(u, local.series_per_mm[..., axis], local.powers)[0]
        for axis in range(2)
    ]
    turned = local.chief_per_mm / local.reference_sine
    of_all = jnp.eye(2, dtype=u.dtype) - defocus_mm * (
        jax.jacfwd(tangent_of)(local.chief_sine) @ local.chief_per_mm
    )

    def followed(i: int, j: int) -> Array:
        against = per_u[i, 0] * turned[0, j] + per_u[i, 1] * turned[1, j]
        return of_all[i, j] + per_mm[j][i] - against

    return followed(0, 0) * followed(1, 1) - followed(0, 1) * followed(1, 0)

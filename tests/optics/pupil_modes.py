"""All modes of the pupil, and the path of a ray whose gradient rays land at."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.aberration import LocalWavefront, landing_and_jacobian_mm
from lensfit.optics.depth import ObjectShift, shifted_path_mm
from lensfit.optics.terms import Mode, wavefront


def modes_up_to(degree: int) -> tuple[Mode, ...]:
    """Of degree 2 ... `degree`, lowest first."""
    return tuple(
        Mode(n, m) for n in range(2, degree + 1) for m in range(n % 2, n + 1, 2)
    )


def path_mm(
    u: Float[Array, "2"], defocus_mm: Float[Array, ""], local: LocalWavefront
) -> Float[Array, ""]:
    """Optical path difference of a ray, 0 for the chief ray."""
    p, chief = u * local.reference_sine, local.chief_sine
    cosine = jnp.sqrt(1 - chief @ chief)
    ray = p + chief
    exact = cosine - jnp.sqrt(1 - ray @ ray) - p @ chief / cosine
    path = wavefront(u, local.series_mm) * local.reference_sine + defocus_mm * exact
    if local.cylinder_mm is not None:
        path = path + p @ local.cylinder_mm @ p / 2
    return path if local.depth is None else path + shift_path_mm(p, local.depth)


def landing_mm(
    u: Float[Array, "2"], defocus_mm: Float[Array, ""], local: LocalWavefront
) -> Float[Array, "2"]:
    """Where a ray lands, without the derivative."""
    return landing_and_jacobian_mm(u, defocus_mm, local)[0]


def shift_path_mm(p: Float[Array, "2"], shift: ObjectShift) -> Float[Array, ""]:
    """What another depth adds to the path of a ray, by its direction cosines."""
    return shifted_path_mm(p[0], p[1], shift)

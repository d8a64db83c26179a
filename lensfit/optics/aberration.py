"""The aberration function of a lens: where every ray of a field point lands.

With p the direction cosines of a ray against the chief ray's, the ray lands at

    x = x_chief + grad_p E(h, p),

exactly and to all orders (Hamilton's mixed characteristic): one scalar function holds
all aberrations. E is a sum of `terms`, whose coefficients are rms spot sizes in
micrometres, and of defocus in its exact form: a sensor dz behind the sharp image gives

    -dz [ sqrt(1 - |p + p_c|^2) - (what is constant and linear in p) ],

p_c being the chief ray's own direction cosine. (The parabola dz p^2 / 2 is 6 % wrong at
the rim of f/1.4.) Every coefficient may depend on wavelength, linearly and
quadratically in the chromatic coordinate of `spectrum`; lateral colour is not here.
Another object distance adds the term of `depth`, cylinders that of `sections`.

Sensor orientation throughout: x right, y down; a positive p moves right as it travels.
Every function takes one field point and one pupil point; callers use `jax.vmap`.

References: W. R. Hamilton's mixed characteristic as in H. A. Buchdahl, Introduction to
Hamiltonian Optics (1970); Restrepo, Stoerck and Ihrke, arXiv 1509.06153.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.depth import ObjectShift, shifted_path_mm
from lensfit.optics.modes import power_series, wavefront_gradient
from lensfit.optics.terms import Term, mode_amplitudes, modes_of

_MM_PER_UM = 1e-3
_LEAST_COSINE_SQUARED = 0.02
"""Rays closer than 8 degrees to the sensor plane are no rays of a lens."""


class Aberration(eqx.Module):
    """All aberrations of a lens at one zoom and focus setting.

    Attributes
    ----------
    coefficients_um : Of `terms`: rms spot over the unit pupil, at the field's edge.
    colour_um : Linear and quadratic change of `colour_terms` with the chromatic
        coordinate.
    field_radius_mm : Unit of the field point.
    reference_sine : Direction cosine that is the unit of the pupil point.
    exit_pupil_distance_mm : From the exit pupil to the sensor; sets p_c.
    chief_bend : Relative change of p_c at the field's edge (pupil aberration).
    """

    coefficients_um: Float[Array, " terms"]
    colour_um: Float[Array, "2 colours"]
    field_radius_mm: Float[Array, ""]
    reference_sine: Float[Array, ""]
    exit_pupil_distance_mm: Float[Array, ""]
    chief_bend: Float[Array, ""]
    terms: tuple[Term, ...] = eqx.field(static=True)
    colour_terms: tuple[Term, ...] = eqx.field(static=True, default=())


class LocalWavefront(eqx.Module):
    """The aberration function of one field point at one wavelength.

    Attributes
    ----------
    series_mm : `modes.power_series` of E over the reference sine, mm.
    chief_sine : p_c.
    series_per_mm, chief_per_mm : How both change with the field point, last axis.
    reference_sine : Unit of the pupil point.
    depth : An object away from where the coefficients hold, or None.
    cylinder_mm : Defocus of the x section beyond that of the sensor, a symmetric
        matrix (`sections.cylinder_mm`), or None.
    """

    series_mm: Float[Array, "orders powers 2"]
    chief_sine: Float[Array, "2"]
    series_per_mm: Float[Array, "orders powers 2 2"]
    chief_per_mm: Float[Array, "2 2"]
    reference_sine: Float[Array, ""]
    depth: ObjectShift | None = None
    cylinder_mm: Float[Array, "2 2"] | None = None


def no_aberration(
    terms: tuple[Term, ...],
    colour_terms: tuple[Term, ...] = (),
    *,
    field_radius_mm: float,
    f_number: float,
    exit_pupil_distance_mm: float,
) -> Aberration:
    """A perfect lens with room for these terms; `f_number` is the widest."""
    return Aberration(
        coefficients_um=jnp.zeros(len(terms)),
        colour_um=jnp.zeros((2, len(colour_terms))),
        field_radius_mm=jnp.asarray(field_radius_mm, float),
        reference_sine=jnp.asarray(0.5 / f_number, float),
        exit_pupil_distance_mm=jnp.asarray(exit_pupil_distance_mm, float),
        chief_bend=jnp.zeros(()),
        terms=terms,
        colour_terms=colour_terms,
    )


def local_wavefront(
    field_point_mm: Float[Array, "2"],
    chromatic: Float[Array, ""],
    aberration: Aberration,
    depth: ObjectShift | None = None,
    cylinder_mm: Float[Array, "2 2"] | None = None,
) -> LocalWavefront:
    """Everything about one field point that does not depend on the ray.

    Parameters
    ----------
    field_point_mm : Where the chief ray lands, from the principal point.
    chromatic : `spectrum.chromatic_coordinate`.
    depth, cylinder_mm : As in `LocalWavefront`.
    """
    powers = jnp.stack([chromatic, chromatic**2])
    coefficients = jnp.concatenate(
        [aberration.coefficients_um, powers @ aberration.colour_um]
    )
    terms = aberration.terms + aberration.colour_terms

    def at(point_mm: Array) -> tuple[Array, Array]:
        h = point_mm / aberration.field_radius_mm
        amplitudes = mode_amplitudes(h, coefficients, terms) * _MM_PER_UM
        series_mm = power_series(amplitudes, modes_of(terms))
        return series_mm, chief_sine(point_mm, aberration)

    series_mm, chief = at(field_point_mm)
    series_per_mm, chief_per_mm = jax.jacfwd(at)(field_point_mm)
    return LocalWavefront(
        series_mm,
        chief,
        series_per_mm,
        chief_per_mm,
        aberration.reference_sine,
        depth,
        cylinder_mm,
    )


def chief_sine(
    field_point_mm: Float[Array, "2"], aberration: Aberration
) -> Float[Array, "2"]:
    """p_c: direction cosines of the chief ray as it lands."""
    length = jnp.sqrt(jnp.sum(field_point_mm**2) + aberration.exit_pupil_distance_mm**2)
    square = jnp.sum(field_point_mm**2) / aberration.field_radius_mm**2
    return field_point_mm / length * (1 + aberration.chief_bend * square)


def landing_mm(
    u: Float[Array, "2"], defocus_mm: Float[Array, ""], local: LocalWavefront
) -> Float[Array, "2"]:
    """Where a ray lands, relative to its chief ray.

    Parameters
    ----------
    u : Pupil point: direction cosines against the chief ray, in reference sines.
    defocus_mm : How far the sensor lies behind the sharp image.
    """
    p = u * local.reference_sine
    slope = defocus_slope(p, local.chief_sine)
    landed = wavefront_gradient(u, local.series_mm) + defocus_mm * slope
    if local.cylinder_mm is not None:
        landed = landed + local.cylinder_mm @ p
    if local.depth is None:
        return landed
    return landed + jax.grad(shifted_path_mm)(p, local.depth)


def defocus_slope(p: Float[Array, "2"], chief: Float[Array, "2"]) -> Float[Array, "2"]:
    """d landing / d defocus: tangent of a ray's angle less the chief ray's.

    Parameters
    ----------
    p : Direction cosines against the chief ray.
    chief : Those of the chief ray.
    """
    return tangent_of(p + chief) - tangent_of(chief)


def landing_and_jacobian_mm(
    u: Float[Array, "2"], defocus_mm: Float[Array, ""], local: LocalWavefront
) -> tuple[Float[Array, "2"], Float[Array, "2 2"]]:
    """`landing_mm` and its derivative with respect to u (mm per unit of u)."""
    landed = landing_mm(u, defocus_mm, local)
    return landed, jax.jacfwd(landing_mm)(u, defocus_mm, local)


def _cosine(p: Array) -> Array:
    return jnp.sqrt(jnp.maximum(1 - p @ p, _LEAST_COSINE_SQUARED))


def tangent_of(p: Float[Array, "2"]) -> Float[Array, "2"]:
    """Tangents of a ray's angle with the sensor's normal, from direction cosines."""
    return p / _cosine(p)

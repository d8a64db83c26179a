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
Another object distance and cylinders add the terms of `depth`.

A dot shines evenly into all directions, counted by their cosines in the scene. With
W(o, P) the mixed characteristic of the lens (o the object point, P the direction
cosines at the sensor) rays land at x = dW/dP and leave the object towards dW/do. So

    d(cosines in the scene) / dP = d^2 W / do dP = (dx / do at fixed P)':

an area of the pupil carries light in proportion to the determinant of how landing
points there follow the object (etendue). It is the same everywhere in the pupil for a
lens without coma, which obeys Abbe's sine condition all over the field; for a fast
double Gauss it varies by a few percent, and biases the centroid of a blurred dot by a
seventh of a pixel.

Sensor orientation throughout: x right, y down; a positive p moves right as it travels.
Every function takes one field point and one pupil point; callers use `jax.vmap`.

References: W. R. Hamilton's mixed characteristic as in H. A. Buchdahl, Introduction to
Hamiltonian Optics (1970); Restrepo, Stoerck and Ihrke, arXiv 1509.06153; W. T. Welford,
Aberrations of Optical Systems (1986), on the optical sine theorem.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lensfit.optics.depth import ObjectShift, shifted_path_mm
from lensfit.optics.terms import (
    Term,
    mode_amplitudes,
    modes_of,
    power_series,
    powers_in,
    wavefront_slopes,
)

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
    series_mm : `terms.power_series` of E over the reference sine, mm.
    chief_sine : p_c.
    series_per_mm, chief_per_mm : How both change with the field point, last axis.
    reference_sine : Unit of the pupil point.
    depth : An object away from where the coefficients hold, or None.
    cylinder_mm : Defocus of the x section beyond that of the sensor, a symmetric
        matrix (`depth.cylinder_mm`), or None.
    powers : `terms.powers_in` the series.
    """

    series_mm: Float[Array, "orders powers 2"]
    chief_sine: Float[Array, "2"]
    series_per_mm: Float[Array, "orders powers 2 2"]
    chief_per_mm: Float[Array, "2 2"]
    reference_sine: Float[Array, ""]
    powers: tuple[int, ...] = eqx.field(static=True)
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
        powers_in(modes_of(terms)),
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


def landing_and_jacobian_mm(
    u: Float[Array, "2"], defocus_mm: Float[Array, ""], local: LocalWavefront
) -> tuple[Float[Array, "2"], Float[Array, "2 2"]]:
    """Where a ray lands, relative to its chief ray; and its derivative with respect to
    u (mm per unit of u).

    Parameters
    ----------
    u : Pupil point: direction cosines against the chief ray, in reference sines.
    defocus_mm : How far the sensor lies behind the sharp image.
    """
    aberrated, per_u = wavefront_slopes(u, local.series_mm, local.powers)

    def beside(p_x: Array, p_y: Array) -> tuple[Array, Array]:
        return _beside_aberrations(p_x, p_y, defocus_mm, local)

    unit = local.reference_sine
    p = u[0] * unit, u[1] * unit
    one, none = jnp.ones_like(p[0]), jnp.zeros_like(p[0])
    landed, along = jax.jvp(beside, p, (one, none))
    _, across = jax.jvp(beside, p, (none, one))
    slope = jnp.stack([jnp.stack([a, b]) for a, b in zip(along, across, strict=True)])
    return aberrated + jnp.stack(landed), per_u + unit * slope


def _beside_aberrations(
    p_x: Array, p_y: Array, defocus_mm: Array, local: LocalWavefront
) -> tuple[Array, Array]:
    """What defocus, cylinders and another depth add, of direction cosines.

    By components, as `terms.wavefront_slopes`.
    """
    chief = local.chief_sine
    x, y = tangents(p_x + chief[0], p_y + chief[1])
    of_chief = tangents(chief[0], chief[1])
    x, y = defocus_mm * (x - of_chief[0]), defocus_mm * (y - of_chief[1])
    if local.cylinder_mm is not None:
        (a, b), (c, d) = local.cylinder_mm
        x, y = x + a * p_x + b * p_y, y + c * p_x + d * p_y
    if local.depth is not None:
        to_x, to_y = jax.grad(shifted_path_mm, (0, 1))(p_x, p_y, local.depth)
        x, y = x + to_x, y + to_y
    return x, y


def tangent_of(p: Float[Array, "2"]) -> Float[Array, "2"]:
    """Tangents of a ray's angle with the sensor's normal, from direction cosines."""
    return jnp.stack(tangents(p[0], p[1]))


def tangents(
    p_x: Float[Array, " *rays"], p_y: Float[Array, " *rays"]
) -> tuple[Float[Array, " *rays"], Float[Array, " *rays"]]:
    """`tangent_of` by components, of many rays at a time."""
    square = 1 - p_x * p_x - p_y * p_y
    cosine = jnp.sqrt(jnp.maximum(square, _LEAST_COSINE_SQUARED))
    return p_x / cosine, p_y / cosine


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
    # the same for every ray. By components, as `terms.wavefront_slopes`.
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

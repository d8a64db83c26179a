"""Where the chief ray of a direction lands: the distortion of one lens state.

    direction -> base projection -> radial profile -> small displacement -> squeeze

Undistorted points lie on the sensor plane of a pinhole camera with the same principal
distance and principal point; both kinds of point are sensor millimetres with the
origin at the sensor centre, x right, y down. Every factor is one-to-one by
construction (`radial`, `field`), so the map has exactly one inverse everywhere.

The squeeze of an anamorphic lens is kept as the two numbers
e = ln(squeeze) (cos 2a, sin 2a), with `a` the azimuth of the squeezed axis: smooth
through "no squeeze", where the azimuth means nothing. The matrix has determinant one,
so that `principal_distance_mm` is the geometric mean of both axes'.

Every function takes one point; callers map it over many with `jax.vmap`.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.optics import field, radial
from lensfit.optics.base import (
    BaseProjection,
    image_of_direction,
    image_of_undistorted,
    undistorted_of_image,
)

_MAX_STEPS = 400
"""Contraction steps that bring a gradient of 0.9 below 1e-16."""


class Distortion(eqx.Module):
    """The chief-ray map of one lens at one focal length and focus.

    Attributes
    ----------
    principal_distance_mm : Image distance of the pinhole (geometric mean of both axes).
    principal_point_mm : Where the axis meets the sensor.
    radial : a1, a2, ... of `radial`; radii in units of `reference_radius_mm`.
    valid_radius : 1.05 times the largest radius of a detection, from the sensor centre
        on the photograph, of any state of the lens; in reference radii. Beyond it the
        radial polynomial levels off (`radial`).
    squeeze : e of the module docstring.
    named : Coefficients of `field.named_basis`.
    free : Coefficients of the free field, x and y.
    box : Low and high corner of the detections of all states, 5 % larger, in reference
        radii from the sensor centre, before the squeeze. Named terms and the free field
        are constant beyond it.
    reference_radius_mm : Unit of radius.
    base : The ideal projection that distortion is measured from.
    degree : Total degree of the free field; below 3 there is none.
    """

    principal_distance_mm: Float[Array, ""]
    principal_point_mm: Float[Array, "2"]
    radial: Float[Array, " radial"]
    valid_radius: Float[Array, ""]
    squeeze: Float[Array, "2"]
    named: Float[Array, " named"]
    free: Float[Array, "2 free"]
    box: Float[Array, "2 2"]
    reference_radius_mm: Float[Array, ""]
    base: BaseProjection = eqx.field(static=True)
    degree: int = eqx.field(static=True)


def no_distortion(
    principal_distance_mm: float,
    reference_radius_mm: float,
    base: BaseProjection = "rectilinear",
) -> Distortion:
    """The ideal lens: every coefficient zero, axis through the sensor centre."""
    return Distortion(
        principal_distance_mm=jnp.asarray(principal_distance_mm, float),
        principal_point_mm=jnp.zeros(2),
        radial=jnp.zeros(0),
        valid_radius=jnp.asarray(1.0, float),
        squeeze=jnp.zeros(2),
        named=jnp.zeros(
            field.DECENTERING_TERMS + field.PRISM_TERMS + field.ANAMORPHIC_TERMS
        ),
        free=jnp.zeros((2, 0)),
        box=jnp.array([[-1.0, -1.0], [1.0, 1.0]]),
        reference_radius_mm=jnp.asarray(reference_radius_mm, float),
        base=base,
        degree=0,
    )


def without_idle_degrees(distortion: Distortion) -> Distortion:
    """The same map with no more degrees in its free field than have coefficients."""
    free, degree = np.asarray(distortion.free), distortion.degree
    while degree and not free[:, len(field.free_degrees(degree - 1)) :].any():
        degree = degree - 1 if degree > field.LOWEST_FREE_DEGREE else 0
        free = free[:, : len(field.free_degrees(degree))]
    return dataclasses.replace(distortion, free=jnp.asarray(free), degree=degree)


def distorted_from_direction(
    direction: Float[Array, "3"], distortion: Distortion
) -> Float[Array, "2"]:
    """Sensor mm where the chief ray of a direction (x right, y down, z ahead) lands."""
    ideal = image_of_direction(direction, distortion.base)
    return _distorted_from_ideal(ideal, distortion)


def distorted_from_undistorted(
    undistorted_mm: Float[Array, "2"], distortion: Distortion
) -> Float[Array, "2"]:
    """Sensor mm on the photograph of a point of the undistorted picture, sensor mm."""
    plane = (
        undistorted_mm - distortion.principal_point_mm
    ) / distortion.principal_distance_mm
    return _distorted_from_ideal(
        image_of_undistorted(plane, distortion.base), distortion
    )


@jax.custom_jvp
def undistorted_from_distorted(
    distorted_mm: Float[Array, "2"], distortion: Distortion
) -> Float[Array, "2"]:
    """Inverse of `distorted_from_undistorted`, to rounding.

    NaN where the base projection has no undistorted point (90 degrees and more off
    axis). Derivatives come from the implicit function theorem, not from the iteration.
    """
    y = (distorted_mm - distortion.principal_point_mm) @ _squeeze_matrix(
        -distortion.squeeze
    )
    y = y / distortion.reference_radius_mm
    q = _before_displacement(y, distortion)
    distorted_radius = jnp.hypot(q[0], q[1])
    radius = radial.undistorted_radius(
        distorted_radius, distortion.radial, distortion.valid_radius**2
    )
    ratio = jnp.where(
        distorted_radius > 0,
        radius / jnp.where(distorted_radius > 0, distorted_radius, 1.0),
        1.0,
    )
    ideal = q * ratio * _reference_per_distance(distortion)
    plane = undistorted_of_image(ideal, distortion.base)
    return distortion.principal_point_mm + plane * distortion.principal_distance_mm


@undistorted_from_distorted.defjvp
def _implicit_derivative(primals, tangents):
    """x = D(u, c) gives du = (dD/du)^-1 (dx - dD/dc dc)."""
    (distorted_mm, distortion), (distorted_dot, distortion_dot) = primals, tangents
    u = undistorted_from_distorted(distorted_mm, distortion)
    jacobian = jacobian_at(u, distortion)
    _, moved = jax.jvp(
        lambda c: distorted_from_undistorted(u, c), (distortion,), (distortion_dot,)
    )
    return u, jnp.linalg.solve(jacobian, distorted_dot - moved)


def jacobian_at(
    undistorted_mm: Float[Array, "2"], distortion: Distortion
) -> Float[Array, "2 2"]:
    """d distorted / d undistorted; its determinant is positive everywhere."""
    return jax.jacfwd(distorted_from_undistorted)(undistorted_mm, distortion)


def radial_image(ideal: Float[Array, "2"], distortion: Distortion) -> Float[Array, "2"]:
    """After the radial profile: reference radii from the principal point, unsqueezed.

    `ideal` is in principal distances, as `base.image_of_direction` gives it.
    """
    b = ideal / _reference_per_distance(distortion)
    return b * radial.magnification(
        jnp.sum(b**2), distortion.radial, distortion.valid_radius**2
    )


def on_sensor_mm(q: Float[Array, "2"], distortion: Distortion) -> Float[Array, "2"]:
    """Squeeze, scale and centre: the last factor of the chain."""
    squeezed = q @ _squeeze_matrix(distortion.squeeze)
    return distortion.principal_point_mm + squeezed * distortion.reference_radius_mm


def box_from_principal_point(distortion: Distortion) -> Float[Array, "2 2"]:
    """The photographed box as the displacement sees it: from the principal point."""
    unsqueezed = distortion.principal_point_mm @ _squeeze_matrix(-distortion.squeeze)
    return distortion.box - (unsqueezed / distortion.reference_radius_mm)[None]


def _distorted_from_ideal(ideal: Array, distortion: Distortion) -> Array:
    q = radial_image(ideal, distortion)
    return on_sensor_mm(q + _displacement(q, distortion), distortion)


def _before_displacement(y: Array, distortion: Distortion) -> Array:
    """The q with q + d(q) = y, by contraction (the gradient of d is below 0.9)."""

    def step(state):
        q, _, k = state
        following = y - _displacement(q, distortion)
        change = jnp.max(jnp.abs(following - q), initial=0.0)
        return following, change > 1e-15, k + 1

    def unfinished(state):
        return state[1] & (state[2] < _MAX_STEPS)

    q, _, _ = jax.lax.while_loop(unfinished, step, (y, jnp.asarray(True), 0))
    return q


def _displacement(q: Array, distortion: Distortion) -> Array:
    box = box_from_principal_point(distortion)
    return field.displacement(
        q, distortion.named, distortion.free, box, distortion.degree
    )


def _reference_per_distance(distortion: Distortion) -> Array:
    return distortion.reference_radius_mm / distortion.principal_distance_mm


def _squeeze_matrix(squeeze: Float[Array, "2"]) -> Float[Array, "2 2"]:
    """exp of the symmetric, traceless matrix with -e/2: shrinks along the axis."""
    e1, e2 = squeeze[0] / 2, squeeze[1] / 2
    half_squared = e1 * e1 + e2 * e2
    small = half_squared < 1e-12
    half = jnp.sqrt(jnp.where(small, 1.0, half_squared))
    cosh = jnp.where(small, 1 + half_squared / 2, jnp.cosh(half))
    sinh_ratio = jnp.where(small, 1 + half_squared / 6, jnp.sinh(half) / half)
    symmetric = jnp.stack([jnp.stack([-e1, -e2]), jnp.stack([-e2, e1])])
    return cosh * jnp.eye(2, dtype=squeeze.dtype) + sinh_ratio * symmetric

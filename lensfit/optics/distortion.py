"""Where the chief ray of a direction lands: the distortion of one lens state.

    direction -> base projection -> radial profile -> small displacement -> squeeze

Undistorted points lie on the sensor plane of a pinhole camera with the same principal
distance and principal point; both kinds of point are sensor millimetres with the
origin at the sensor centre, x right, y down. Every factor is one-to-one by
construction (`field` for the displacement), so the map has exactly one inverse
everywhere.

The squeeze of an anamorphic lens is kept as the two numbers
e = ln(squeeze) (cos 2a, sin 2a), with `a` the azimuth of the squeezed axis: smooth
through "no squeeze", where the azimuth means nothing. The matrix has determinant one,
so that `principal_distance_mm` is the geometric mean of both axes'.

The radial profile cannot fold. With r the undistorted radius in units of a stated
reference radius, the slope of the distorted radius is parametrised, not the radius
itself:

    d r' / d r = exp(P(r^2)),    P(s) = a1 s + a2 s^2 + ...,

so that r' = r g(r^2), g(s) = integral over t in [0, 1] of exp(P(s t^2)), increases
whatever the coefficients are. (Published lens databases do hold polynomials that fold
inside the frame.) To first order a1 is three times Brown's k1. Beyond the radius that
was photographed, s is led smoothly to a ceiling, which it reaches at 1.29 times that
radius; from there on the profile is a straight line, and integrated as one.

Every function takes one point; callers map it over many with `jax.vmap`.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.optics import field
from lensfit.optics.projection import (
    BaseProjection,
    image_of_direction,
    image_of_undistorted,
    undistorted_of_image,
)

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(14)
_T_SQUARED = ((_NODES + 1) / 2) ** 2
_T_WEIGHTS = _WEIGHTS / 2
_HEADROOM = 0.35
"""How much the polynomial's argument still grows beyond the photographed squared
radius."""
_CEILING_AT = 15 * _HEADROOM / 8
"""How far beyond it, in its units, the ceiling is reached."""
_NEWTON_STEPS = 60
_ACCEPTED = 1e-9
"""Relative error of the distorted radius beyond which there is no inverse."""
_MAX_STEPS = 400
"""Contraction steps that bring a gradient of 0.9 below 1e-16."""


def log_slope(
    squared_radius: Float[Array, "*nodes"],
    coefficients: Float[Array, " terms"],
    valid_squared_radius: Float[Array, ""],
) -> Float[Array, "*nodes"]:
    """P(s): the logarithm of d r'/d r at squared radius s."""
    s = _bounded_square(squared_radius, valid_squared_radius)
    total = jnp.zeros_like(s)
    for k in range(coefficients.shape[0] - 1, -1, -1):
        total = (total + coefficients[k]) * s
    return total


@jax.custom_jvp
def magnification(
    squared_radius: Float[Array, ""],
    coefficients: Float[Array, " terms"],
    valid_squared_radius: Float[Array, ""],
) -> Float[Array, ""]:
    """g(s) = r'/r, by Gauss-Legendre quadrature of the slope.

    `valid_squared_radius` is data: no derivative flows through it.
    """
    return jnp.sum(_weighted_slopes(squared_radius, coefficients, valid_squared_radius))


@magnification.defjvp
def _magnification_derivative(primals, tangents):
    """Quadrature of dP, so that a tangent costs a few products and not 14 nodes."""
    s, coefficients, valid = primals
    s_dot, coefficients_dot, _ = tangents
    slopes = _weighted_slopes(s, coefficients, valid)
    ceiling = valid * (1 + _CEILING_AT)
    nodes, curved, node_slope = _nodes(s, valid)
    bounded, bounded_slope = jax.vmap(
        lambda node: jax.jvp(
            lambda v: _bounded_square(v, valid), (node,), (jnp.ones_like(node),)
        )
    )(nodes)
    terms = coefficients.shape[0]
    lower = [jnp.ones_like(bounded)]
    for _ in range(terms):
        lower.append(lower[-1] * bounded)
    orders = jnp.arange(1, terms + 1, dtype=s.dtype)
    by_s = jnp.stack(lower, 1)[:, :terms] @ (coefficients * orders)
    powers = jnp.stack(lower, 1)[:, 1:]
    change_s = slopes @ (by_s * bounded_slope * node_slope)
    straight = jnp.exp(log_slope(ceiling, coefficients, valid))
    excess = jnp.sum(slopes[:-1]) - curved * straight
    change_s = change_s - jnp.where(
        curved < 1, excess / (2 * jnp.maximum(s, ceiling)), 0.0
    )
    change_coefficients = slopes @ powers
    moved = change_s * s_dot + change_coefficients @ coefficients_dot
    return jnp.sum(slopes), moved


def _weighted_slopes(s: Array, coefficients: Array, valid: Array) -> Array:
    """w_j exp(P(s t_j^2)) at the nodes of the quadrature, and of the straight part."""
    nodes, curved, _ = _nodes(s, valid)
    weights = jnp.append(curved * jnp.asarray(_T_WEIGHTS, s.dtype), 1 - curved)
    return weights * jnp.exp(log_slope(nodes, coefficients, valid))


def _nodes(s: Array, valid: Array) -> tuple[Array, Array, Array]:
    """Squared radii of the nodes, share of the radius that is curved, d nodes / d s."""
    ceiling = valid * (1 + _CEILING_AT)
    t_squared = jnp.asarray(_T_SQUARED, s.dtype)
    nodes = jnp.append(jnp.minimum(s, ceiling) * t_squared, ceiling)
    curved = jnp.sqrt(ceiling / jnp.maximum(s, ceiling))
    moving = jnp.where(s < ceiling, jnp.append(t_squared, 0.0), 0.0)
    return nodes, curved, moving


def undistorted_radius(
    distorted_radius: Float[Array, ""],
    coefficients: Float[Array, " terms"],
    valid_squared_radius: Float[Array, ""],
) -> Float[Array, ""]:
    """The r with r g(r^2) = r', by bracketed Newton steps to machine precision.

    The profile increases without bound, so every radius >= 0 has exactly one inverse.
    NaN where steps end before it is found: slopes far beyond any lens (e^+-60).
    Not differentiable: the inverse map supplies the implicit derivative.
    """
    args = (coefficients, valid_squared_radius)

    def forward(r):
        return r * magnification(r**2, *args)

    def widen(state):
        high, k = state
        return 2 * high, k + 1

    def too_low(state):
        high, k = state
        return (forward(high) < distorted_radius) & (k < _NEWTON_STEPS)

    high, _ = jax.lax.while_loop(too_low, widen, (2 * distorted_radius + 1e-300, 0))
    low = jnp.zeros_like(high)

    def step(state):
        r, low, high, *_, k = state
        excess = forward(r) - distorted_radius
        low, high = jnp.where(excess < 0, r, low), jnp.where(excess > 0, r, high)
        newton = r - excess * jnp.exp(-log_slope(r**2, *args))
        inside = (newton >= low) & (newton <= high)
        following = jnp.where(inside, newton, (low + high) / 2)
        change = jnp.abs(following - r) > 4e-16 * jnp.abs(r)
        return following, low, high, jnp.abs(excess), change, k + 1

    def unfinished(state):
        *_, changing, k = state
        return changing & (k < _NEWTON_STEPS)

    start = (distorted_radius, low, high, low, jnp.asarray(True), 0)
    r, _, _, off, *_ = jax.lax.while_loop(unfinished, step, start)
    return jnp.where(off <= _ACCEPTED * distorted_radius, r, jnp.nan)


def _bounded_square(s: Array, valid: Array) -> Array:
    """s up to the valid squared radius, then levelling off; twice differentiable.

    Beyond it the slope is (1 - u^2)^2, with u running from 0 to 1 at the ceiling.
    """
    u = jnp.clip((s / valid - 1) / _CEILING_AT, 0.0, 1.0)
    beyond = u * (1 - u**2 * (2 / 3 - u**2 / 5))
    return jnp.minimum(s, valid) + valid * _CEILING_AT * beyond


class Distortion(eqx.Module):
    """The chief-ray map of one lens at one focal length and focus.

    Attributes
    ----------
    principal_distance_mm : Image distance of the pinhole (geometric mean of both axes).
    principal_point_mm : Where the axis meets the sensor.
    radial : a1, a2, ... of the profile; radii in units of `reference_radius_mm`.
    valid_radius : 1.05 times the largest radius of a detection, from the sensor centre
        on the photograph, of any state of the lens; in reference radii. Beyond it the
        radial polynomial levels off.
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
    radius = undistorted_radius(
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
    return b * magnification(
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

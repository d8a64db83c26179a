"""The radial part of distortion: a profile that cannot fold.

With r the undistorted radius in units of a stated reference radius, the slope of the
distorted radius is parametrised, not the radius itself:

    d r' / d r = exp(P(r^2)),    P(s) = a1 s + a2 s^2 + ...,

so that r' = r g(r^2), g(s) = integral over t in [0, 1] of exp(P(s t^2)), increases
whatever the coefficients are. (Published lens databases do hold polynomials that fold
inside the frame.) To first order a1 is three times Brown's k1. Beyond the radius that
was photographed, s is led smoothly to a ceiling, which it reaches at 1.29 times that
radius; from there on the profile is a straight line, and integrated as one.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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


def log_slope(
    squared_radius: Float[Array, "*nodes"],
    coefficients: Float[Array, " terms"],
    valid_squared_radius: Float[Array, ""],
) -> Float[Array, "*nodes"]:
    """P(s): the logarithm of d r'/d r at squared radius s."""
    s = _bounded(squared_radius, valid_squared_radius)
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
            lambda v: _bounded(v, valid), (node,), (jnp.ones_like(node),)
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
    Not differentiable: `lensfit.optics.distortion` supplies the implicit derivative.
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


def _bounded(s: Array, valid: Array) -> Array:
    """s up to the valid squared radius, then levelling off; twice differentiable.

    Beyond it the slope is (1 - u^2)^2, with u running from 0 to 1 at the ceiling.
    """
    u = jnp.clip((s / valid - 1) / _CEILING_AT, 0.0, 1.0)
    beyond = u * (1 - u**2 * (2 / 3 - u**2 / 5))
    return jnp.minimum(s, valid) + valid * _CEILING_AT * beyond

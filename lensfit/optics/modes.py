"""Pupil modes: the shapes a wavefront takes over the pupil at one field point.

A mode is C(P) Re(z^m) or C(P) Im(z^m), with z = u_x + i u_y the pupil point in units of
the reference aperture, P = |z|^2 and C a polynomial. The combinations

    R_n^m - R_{n-2}^m  (n > m),      R_m^m  (n = m)

of Zernike's radial polynomials have gradients that are orthogonal over the unit disc
(Zhao and Burge, Opt. Express 15 (2007) 18014): since a photograph shows the gradient,
the modes of one field point are told apart as well as any can be. Each is scaled to a
root mean square gradient of 1, so that a coefficient is the rms spot size that it adds.
What is linear in u is then taken out of the modes with m = 1: a shift of the whole spot
belongs to distortion and lateral colour, and the ray through the pupil's centre stays
where it is.

Every function takes one pupil point; callers map it over many with `jax.vmap`.
"""

from functools import lru_cache
from math import factorial, sqrt
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Mode(NamedTuple):
    """Degree n and azimuthal order m of a pair (Re, Im) of pupil modes."""

    degree: int
    order: int


@lru_cache(maxsize=256)
def radial_polynomial(degree: int, order: int) -> np.ndarray:
    """Zernike's R_n^m(r) / r^m as coefficients of powers of r^2."""
    n, m = degree, order
    powers = np.zeros((n - m) // 2 + 1)
    for k in range(len(powers)):
        sign = -1.0 if k % 2 else 1.0
        powers[-1 - k] = (
            sign
            * factorial(n - k)
            / (factorial(k) * factorial((n + m) // 2 - k) * factorial((n - m) // 2 - k))
        )
    return powers


@lru_cache(maxsize=256)
def mode_polynomial(degree: int, order: int) -> np.ndarray:
    """C(P) of a mode as coefficients of powers of P."""
    n, m = degree, order
    powers = radial_polynomial(n, m).copy()
    if n > m:
        powers[:-1] -= radial_polynomial(n - 2, m)
        powers /= sqrt(2 * n) if m else 2 * sqrt(n)
    else:
        powers /= sqrt(n)
    if m < 2:
        powers[0] = 0.0  # constants do nothing; a tilt moves the spot
    return powers


@lru_cache(maxsize=32)
def _table(modes: tuple[Mode, ...]) -> np.ndarray:
    """(modes, orders, powers): which power series in P multiplies z^m."""
    orders = max((m.order for m in modes), default=0) + 1
    powers = max(((m.degree - m.order) // 2 for m in modes), default=0) + 1
    table = np.zeros((len(modes), orders, powers))
    for row, (n, m) in enumerate(modes):
        polynomial = mode_polynomial(n, m)
        table[row, m, : len(polynomial)] = polynomial
    return table


def power_series(
    amplitudes: Float[Array, "modes 2"], modes: tuple[Mode, ...]
) -> Float[Array, "orders powers 2"]:
    """The wavefront of one field point as sum over m, k of a_mk P^k z^m.

    Parameters
    ----------
    amplitudes : Of the Re and Im member of each mode.
    """
    table = jnp.asarray(_table(modes), amplitudes.dtype)
    return jnp.einsum("jmk,jc->mkc", table, amplitudes)


def wavefront(
    u: Float[Array, "2"], series: Float[Array, "orders powers 2"]
) -> Float[Array, ""]:
    """E(u) of a `power_series`."""
    radial, _ = _radial(u, series)
    re, im = powers_of(u, series.shape[0])
    return jnp.sum(radial[:, 0] * re + radial[:, 1] * im)


def wavefront_gradient(
    u: Float[Array, "2"], series: Float[Array, "orders powers 2"]
) -> Float[Array, "2"]:
    """dE/du of a `power_series`.

    In closed form, with a_m = A + i B and primes for d/dP, as a complex number:
    sum over m of 2 z (A' Re z^m + B' Im z^m) + m (A + i B) conj(z)^(m - 1).
    """
    radial, slope = _radial(u, series)
    orders = series.shape[0]
    re, im = powers_of(u, orders)
    spread = 2 * jnp.sum(slope[:, 0] * re + slope[:, 1] * im)
    m = jnp.arange(1, orders, dtype=u.dtype)
    a, b = m * radial[1:, 0], m * radial[1:, 1]
    re, im = re[:-1], im[:-1]
    turning = jnp.stack([jnp.sum(a * re + b * im), jnp.sum(b * re - a * im)])
    return spread * u + turning


@lru_cache(maxsize=32)
def _by_mode(modes: tuple[Mode, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Azimuthal order of each mode, and its polynomial in P, (modes, powers)."""
    orders = np.array([m.order for m in modes], int)
    table = _table(modes)
    return orders, table[np.arange(len(modes)), orders]


def mode_gradients(
    u: Float[Array, "2"], modes: tuple[Mode, ...]
) -> Float[Array, "modes 2 2"]:
    """Gradient of every mode: of its Re and Im member, along x and y."""
    orders, powers = _by_mode(modes)
    square = u[0] * u[0] + u[1] * u[1]
    value = jnp.asarray(powers[:, -1], u.dtype)
    slope = jnp.zeros_like(value)
    for k in range(powers.shape[1] - 2, -1, -1):
        slope = slope * square + value
        value = value * square + jnp.asarray(powers[:, k], u.dtype)
    re, im = powers_of(u, int(orders.max(initial=0)) + 1)
    lower = np.maximum(orders - 1, 0)
    turn = value * jnp.asarray(orders, u.dtype)
    spread_re, spread_im = 2 * slope * re[orders], 2 * slope * im[orders]
    turn_re, turn_im = turn * re[lower], turn * im[lower]
    of_re = jnp.stack([spread_re * u[0] + turn_re, spread_re * u[1] - turn_im], -1)
    of_im = jnp.stack([spread_im * u[0] + turn_im, spread_im * u[1] + turn_re], -1)
    return jnp.stack([of_re, of_im], 1)


def powers_of(u: Float[Array, "2"], count: int) -> tuple[Array, Array]:
    """Re and Im of z^0 ... z^(count - 1)."""
    re, im = [jnp.ones_like(u[0])], [jnp.zeros_like(u[0])]
    for _ in range(count - 1):
        real, imaginary = re[-1], im[-1]
        re.append(real * u[0] - imaginary * u[1])
        im.append(real * u[1] + imaginary * u[0])
    return jnp.stack(re), jnp.stack(im)


def _radial(u: Array, series: Array) -> tuple[Array, Array]:
    """sum_k a_mk P^k and its derivative with respect to P, for every m."""
    square = u[0] * u[0] + u[1] * u[1]
    value = series[:, -1]
    slope = jnp.zeros_like(value)
    for k in range(series.shape[1] - 2, -1, -1):
        slope = slope * square + value
        value = value * square + series[:, k]
    return value, slope

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

_ZERO = 0.0, 0.0
"""As a complex number."""


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


def powers_in(modes: tuple[Mode, ...]) -> tuple[int, ...]:
    """How many powers of P a series of these modes has with every z^m."""
    found = [0] * (max((m.order for m in modes), default=0) + 1)
    for n, m in modes:
        found[m] = max(found[m], (n - m) // 2 + 1)
    return tuple(found)


def wavefront(
    u: Float[Array, "2"], series: Float[Array, "orders powers 2"]
) -> Float[Array, ""]:
    """E(u) of a `power_series`."""
    square = u[0] * u[0] + u[1] * u[1]
    radial = jnp.zeros_like(series[:, 0])
    for k in range(series.shape[1] - 1, -1, -1):
        radial = radial * square + series[:, k]
    re, im = powers_of(u, series.shape[0])
    return jnp.sum(radial[:, 0] * re + radial[:, 1] * im)


def wavefront_slopes(
    u: Float[Array, "2"],
    series: Float[Array, "orders powers 2"],
    powers: tuple[int, ...] | None = None,
) -> tuple[Float[Array, "2"], Float[Array, "2 2"]]:
    """dE/du and d^2E/du^2 of a `power_series`.

    In closed form, with a_m = A + i B, primes for d/dP, and as complex numbers, each
    summed over m,

        s = A Re z^m + B Im z^m,
        t = m a_m conj(z)^(m - 1),
        q = m (m - 1) a_m conj(z)^(m - 2):

    the gradient is 2 s' z + t, and a step dz changes it by

        2 s' dz + (4 s'' z + 2 t') z.dz + 2 z t'.dz + q conj(dz).

    Parameters
    ----------
    powers : Of P with z^m that occur, for every m (static); None for all.
    """
    # One number at a time: mapped over many rays every line is then one long array,
    # where arrays of a few numbers for each ray are several times slower.
    x, y = u[0], u[1]
    square = x * x + y * y
    zero = jnp.zeros_like(x)
    s1, s2, t, t1, q = zero, zero, _ZERO, _ZERO, _ZERO
    turned = [(jnp.ones_like(x), zero)]
    orders = series.shape[0]
    for m, count in enumerate(powers or (series.shape[1],) * orders):
        if m:
            re, im = turned[-1]
            turned.append((re * x - im * y, re * y + im * x))
        if not count:
            continue
        a, a1, a2 = _horner(square, [series[m, k, 0] for k in range(count)])
        re, im = turned[m]
        if not m:
            s1, s2 = s1 + a1, s2 + a2
            continue
        b, b1, b2 = _horner(square, [series[m, k, 1] for k in range(count)])
        s1, s2 = s1 + a1 * re + b1 * im, s2 + a2 * re + b2 * im
        t = _plus_conjugate(t, m, (a, b), turned[m - 1])
        t1 = _plus_conjugate(t1, m, (a1, b1), turned[m - 1])
        if m > 1:
            q = _plus_conjugate(q, m * (m - 1), (a, b), turned[m - 2])
    gradient = 2 * s1 * x + t[0], 2 * s1 * y + t[1]
    xx = 2 * s1 + 4 * (s2 * x + t1[0]) * x + q[0]
    yy = 2 * s1 + 4 * (s2 * y + t1[1]) * y - q[0]
    xy = 4 * s2 * x * y + 2 * (t1[0] * y + t1[1] * x) + q[1]
    return (
        jnp.stack(gradient),
        jnp.stack([jnp.stack([xx, xy]), jnp.stack([xy, yy])]),
    )


@lru_cache(maxsize=32)
def _by_mode(modes: tuple[Mode, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Azimuthal order of each mode, and its polynomial in P, (modes, powers)."""
    orders = np.array([m.order for m in modes], int)
    table = _table(modes)
    return orders, table[np.arange(len(modes)), orders]


def mode_gradients(
    u: Float[Array, "2 *rays"], modes: tuple[Mode, ...]
) -> Float[Array, "modes 2 2 *rays"]:
    """Gradient of every mode: of its Re and Im member, along x and y.

    Of many rays at a time: with their axes last the processor goes along them.
    """
    orders, powers = _by_mode(modes)

    def of_modes(numbers: np.ndarray) -> Array:
        """Constants, to go with rays."""
        return jnp.asarray(numbers, u.dtype).reshape(-1, *[1] * (u.ndim - 1))

    x, y = u[0][None], u[1][None]
    square = x * x + y * y
    value = of_modes(powers[:, -1])
    slope = jnp.zeros_like(value)
    for k in range(powers.shape[1] - 2, -1, -1):
        slope = slope * square + value
        value = value * square + of_modes(powers[:, k])
    re, im = powers_of(u, int(orders.max(initial=0)) + 1)
    lower = np.maximum(orders - 1, 0)
    turn = value * of_modes(orders)
    spread_re, spread_im = 2 * slope * re[orders], 2 * slope * im[orders]
    turn_re, turn_im = turn * re[lower], turn * im[lower]
    of_re = jnp.stack([spread_re * x + turn_re, spread_re * y - turn_im], 1)
    of_im = jnp.stack([spread_im * x + turn_im, spread_im * y + turn_re], 1)
    return jnp.stack([of_re, of_im], 1)


def powers_of(u: Float[Array, "2 *rays"], count: int) -> tuple[Array, Array]:
    """Re and Im of z^0 ... z^(count - 1)."""
    re, im = [jnp.ones_like(u[0])], [jnp.zeros_like(u[0])]
    for _ in range(count - 1):
        real, imaginary = re[-1], im[-1]
        re.append(real * u[0] - imaginary * u[1])
        im.append(real * u[1] + imaginary * u[0])
    return jnp.stack(re), jnp.stack(im)


def _plus_conjugate(so_far, factor: int, a, z):
    """A complex number, and the factor times a conj(z)."""
    return (
        so_far[0] + factor * (a[0] * z[0] + a[1] * z[1]),
        so_far[1] + factor * (a[1] * z[0] - a[0] * z[1]),
    )


def _horner(x: Array, coefficients: list[Array]) -> tuple[Array, Array, Array]:
    """A polynomial and its first two derivatives."""
    zero = jnp.zeros_like(x)
    value, slope, half_curvature = coefficients[-1] + zero, zero, zero
    for coefficient in reversed(coefficients[:-1]):
        half_curvature = half_curvature * x + slope
        slope = slope * x + value
        value = value * x + coefficient
    return value, slope, 2 * half_curvature

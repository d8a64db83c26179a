"""Terms of the aberration function: pupil modes, and how each varies over the field.

A term is a field function times a pupil mode,

    T(h, u) = Re or Im of [ conj(eta(h)) u^m ] F(|h|^2) C(|u|^2),

with h the field point in units of the field radius, u the pupil point, both as complex
numbers, C the polynomial of the mode, and eta F the Zernike polynomial of
degree `field_degree` and azimuthal order |k| over the field disc: h^k, or its conjugate
when k < 0. A field function is 1 (Re, on the x axis) at the edge of the field.

Which terms a lens may have is its symmetry:
- rotation and a mirror: k = m, Re. These are polynomials in h.h, h.u and u.u;
- two mirrors (anamorphic): k + m even, Re, either sign of k;
- none (decentred elements): any.

`order` is the order of the transverse aberration, field_degree + degree - 1: Seidel's
terms have 3. The coefficient of a term is the rms spot radius that it adds over the
unit pupil at the edge of the field.

Pupil modes are the shapes that a wavefront takes over the pupil at one field point. A
mode is C(P) Re(z^m) or C(P) Im(z^m), with z = u_x + i u_y the pupil point in units of
the reference aperture, P = |z|^2 and C a polynomial. The combinations

    R_n^m - R_{n-2}^m  (n > m),      R_m^m  (n = m)

of Zernike's radial polynomials have gradients that are orthogonal over the unit disc
(Zhao and Burge, Opt. Express 15 (2007) 18014): since a photograph shows the gradient,
the modes of one field point are told apart as well as any can be. Each is scaled to a
root mean square gradient of 1, so that a coefficient is the rms spot size that it adds.
What is linear in u is then taken out of the modes with m = 1: a shift of the whole spot
belongs to distortion and lateral colour, and the ray through the pupil's centre stays
where it is.

In powers of P a mode holds on the unit disc alone, and in single precision, as in the
fit, up to degree 10 or so (slopes to 1e-5): beyond, powers cancel.

Functions take one field or pupil point, which callers map over many with `jax.vmap`,
where they do not say that they take rays.

References: W. T. Welford, Aberrations of Optical Systems (1986); J. J. M. Braat and
A. J. E. M. Janssen, J. Opt. Soc. Am. A 30 (2013) 1213, for double Zernike expansions.
"""

from collections.abc import Iterable
from functools import lru_cache
from math import factorial, sqrt
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_ZERO = 0.0, 0.0
"""As a complex number."""
Part = Literal["re", "im"]
_NAMES = {
    (2, 0): "focus",
    (2, 2): "astigmatism",
    (3, 1): "coma",
    (3, 3): "trefoil",
    (4, 0): "spherical",
    (4, 2): "oblique spherical",
}


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
def _orders_and_polynomials(modes: tuple[Mode, ...]) -> tuple[np.ndarray, np.ndarray]:
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
    orders, powers = _orders_and_polynomials(modes)

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


class Term(NamedTuple):
    """One field function times one pupil mode; see the module."""

    degree: int
    order_u: int
    field_degree: int
    field_order: int
    part: Part = "re"

    @property
    def order(self) -> int:
        """Order of the transverse aberration; 1 is defocus."""
        return self.degree + self.field_degree - 1

    @property
    def family(self) -> str:
        """What lens designers call it, and its order, for example "coma 5"."""
        name = _NAMES.get((self.degree, self.order_u))
        if (self.degree, self.order_u) == (2, 0):
            name = "field curvature" if self.field_degree else "defocus"
        name = name or f"mode {self.degree},{self.order_u}"
        if self.part == "im" or self.order_u != self.field_order:
            name = f"asymmetric {name}"
        return f"{name} {self.order}"


def rotational_terms(highest_order: int) -> tuple[Term, ...]:
    """Terms of a centred lens up to an order (1, 3, 5, 7, 9), lowest order first.

    1, 5, 13, 26 and 45 of them.
    """
    found = [
        Term(n, m, field_degree, m)
        for n in range(2, highest_order + 2)
        for m in range(n % 2, n + 1, 2)
        for field_degree in range(m, highest_order + 2 - n, 2)
    ]
    return tuple(sorted(found, key=lambda t: (t.order, t.degree, t.order_u)))


def two_mirror_terms(highest_order: int) -> tuple[Term, ...]:
    """Terms of an anamorphic lens that a centred lens lacks, axes along x and y."""
    found = [
        term
        for term in _all_terms(highest_order)
        if term.part == "re"
        and (term.order_u + term.field_order) % 2 == 0
        and term.field_order != term.order_u
    ]
    return tuple(sorted(found, key=lambda t: (t.order, t.degree, t.order_u)))


def decentring_terms() -> tuple[Term, ...]:
    """The lowest terms that displaced elements add (nodal aberration theory).

    A tilted focal surface, coma that is the same all over the field, and astigmatism
    that is constant, or linear, in the field.
    """
    tilt = [Term(2, 0, 1, 1, part) for part in ("re", "im")]
    coma = [Term(3, 1, 0, 0, part) for part in ("re", "im")]
    constant = [Term(2, 2, 0, 0, part) for part in ("re", "im")]
    linear = [Term(2, 2, 1, 1, part) for part in ("re", "im")]
    return tuple(tilt + coma + constant + linear)


def _all_terms(highest_order: int) -> Iterable[Term]:
    for n in range(2, highest_order + 2):
        for m in range(n % 2, n + 1, 2):
            for field_degree in range(highest_order + 2 - n):
                start = field_degree % 2
                for k in range(start, field_degree + 1, 2):
                    for signed in {k, -k} if m else {k}:
                        yield Term(n, m, field_degree, signed, "re")
                        if m or k:
                            yield Term(n, m, field_degree, signed, "im")


def modes_of(terms: tuple[Term, ...]) -> tuple[Mode, ...]:
    """The pupil modes that these terms need."""
    return tuple(sorted({Mode(t.degree, t.order_u) for t in terms}))


@lru_cache(maxsize=64)
def _field_tables(terms: tuple[Term, ...]):
    """Powers of |h|^2, azimuthal order, and where each term adds to the modes."""
    depth = max(((t.field_degree - abs(t.field_order)) // 2 for t in terms), default=0)
    powers = np.zeros((len(terms), depth + 1))
    modes = modes_of(terms)
    row = np.zeros(len(terms), int)
    for i, t in enumerate(terms):
        radial = radial_polynomial(t.field_degree, abs(t.field_order))
        powers[i, : len(radial)] = radial
        row[i] = modes.index(Mode(t.degree, t.order_u))
    signed = np.array([t.field_order for t in terms], int)
    imaginary = np.array([t.part == "im" for t in terms])
    return powers, signed, row, imaginary


def term_amplitudes(
    h: Float[Array, "2"], terms: tuple[Term, ...]
) -> tuple[np.ndarray, Float[Array, "terms 2"]]:
    """What a unit of each term adds at one field point, and to which mode.

    Returns
    -------
    Index into `modes_of(terms)` (static), and amplitude of its Re and Im member.
    """
    powers, signed, row, imaginary = _field_tables(terms)
    square = h[0] * h[0] + h[1] * h[1]
    radial = jnp.zeros(len(terms), h.dtype)
    for k in range(powers.shape[1] - 1, -1, -1):
        radial = radial * square + jnp.asarray(powers[:, k], h.dtype)
    re, im = powers_of(h, int(np.max(np.abs(signed), initial=0)) + 1)
    eta_re = re[np.abs(signed)]
    eta_im = im[np.abs(signed)] * jnp.asarray(np.sign(signed), h.dtype)
    # Re[conj(eta) z] = eta_re Re z + eta_im Im z; Im[...] = eta_re Im z - eta_im Re z.
    swap = jnp.asarray(imaginary)
    along = jnp.where(swap, -eta_im, eta_re)
    across = jnp.where(swap, eta_re, eta_im)
    return row, jnp.stack([along, across], -1) * radial[:, None]


def mode_amplitudes(
    h: Float[Array, "2"], coefficients: Float[Array, " terms"], terms: tuple[Term, ...]
) -> Float[Array, "modes 2"]:
    """Amplitudes of the pupil modes `modes_of(terms)` at one field point.

    Parameters
    ----------
    h : Field point in field radii.
    """
    row, pair = term_amplitudes(h, terms)
    zero = jnp.zeros((len(modes_of(terms)), 2), coefficients.dtype)
    return zero.at[row].add(pair * coefficients[:, None])

"""Terms of the aberration function: how each pupil mode varies over the field.

A term is a field function times a pupil mode,

    T(h, u) = Re or Im of [ conj(eta(h)) u^m ] F(|h|^2) C(|u|^2),

with h the field point in units of the field radius, u the pupil point, both as complex
numbers, C the polynomial of the mode (`modes`), and eta F the Zernike polynomial of
degree `field_degree` and azimuthal order |k| over the field disc: h^k, or its conjugate
when k < 0. A field function is 1 (Re, on the x axis) at the edge of the field.

Which terms a lens may have is its symmetry:
- rotation and a mirror: k = m, Re. These are polynomials in h.h, h.u and u.u;
- two mirrors (anamorphic): k + m even, Re, either sign of k;
- none (decentred elements): any.

`order` is the order of the transverse aberration, field_degree + degree - 1: Seidel's
terms have 3. The coefficient of a term is the rms spot radius that it adds over the
unit pupil at the edge of the field.

References: W. T. Welford, Aberrations of Optical Systems (1986); J. J. M. Braat and
A. J. E. M. Janssen, J. Opt. Soc. Am. A 30 (2013) 1213, for double Zernike expansions.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lensfit.optics.modes import Mode, powers_of, radial_polynomial

Part = Literal["re", "im"]


_NAMES = {
    (2, 0): "focus",
    (2, 2): "astigmatism",
    (3, 1): "coma",
    (3, 3): "trefoil",
    (4, 0): "spherical",
    (4, 2): "oblique spherical",
}


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

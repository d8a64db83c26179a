"""Distortion that is not radial: small, smooth displacements that never fold.

On the radially distorted image q (in reference radii, from the principal point) the
displacement is a sum of named terms with one coefficient each, and a free field:

- decentering: Brown's two terms, and the same two times r^2;
- thin prism: r^2 and r^4 along each axis;
- anamorphic: the terms of odd degree up to five that keep both mirror symmetries
  (angular harmonics 0, 2 and 4, as in the anamorphic models of the trade);
- the free field: Chebyshev polynomials T_i(x) T_j(y), 3 <= i + j <= degree, over the
  box that was photographed; degrees below three belong to the pose and the terms above.
  Its place is fixed to the sensor, so that it stays put when the principal point moves.

A map q + d(q) is one-to-one when d changes by less than q does. The coefficients
are therefore scaled down, smoothly, as the bound on the gradient of d over the box
nears `MAX_GRADIENT`, and outside the box d is continued by its value at the border.

Every function takes one point; callers map it over many with `jax.vmap`.

References: D. C. Brown, Photogrammetric Engineering 32 (1966) 444-462; the anamorphic
terms span those of 3DEqualizer's "Anamorphic, degree 4".
"""

from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

MAX_GRADIENT = 0.9
DECENTERING_TERMS = 4
PRISM_TERMS = 4
ANAMORPHIC_TERMS = 8
LOWEST_FREE_DEGREE = 3


def named_basis(q: Float[Array, "2"]) -> Float[Array, "terms 2"]:
    """Decentering, thin-prism and anamorphic displacements per unit coefficient."""
    terms = _named_terms(q[0], q[1], jnp.zeros_like(q[0]))
    return jnp.stack([jnp.stack(term) for term in terms])


def _named_displacement(
    q: Float[Array, "2"], named: Float[Array, " terms"]
) -> Float[Array, "2"]:
    """`named @ named_basis(q)`, summed up term by term: no array of all terms is made
    for every point, and much less is compiled."""
    x = y = jnp.zeros_like(q[0])
    for k, (x_term, y_term) in enumerate(_named_terms(q[0], q[1], None)):
        x = x if x_term is None else x + named[k] * x_term
        y = y if y_term is None else y + named[k] * y_term
    return jnp.stack([x, y])


def _named_terms(x: Any, y: Any, zero: Any) -> list[tuple[Any, Any]]:
    """x and y of each term; polynomials of x and y with integer coefficients."""
    x2, y2 = x * x, y * y
    r2 = x2 + y2
    second, fourth = x2 - y2, x2 * x2 - 6 * x2 * y2 + y2 * y2
    decentering = [(2 * x * y, r2 + 2 * y2), (r2 + 2 * x2, 2 * x * y)]
    decentering += [(r2 * a, r2 * b) for a, b in decentering]
    prism = [(r2, zero), (zero, r2), (r2 * r2, zero), (zero, r2 * r2)]
    anamorphic = [
        (x * r2, -y * r2),
        (x * second, zero),
        (zero, y * second),
        (x * r2 * r2, -y * r2 * r2),
        (x * r2 * second, zero),
        (zero, y * r2 * second),
        (x * fourth, zero),
        (zero, y * fourth),
    ]
    return decentering + prism + anamorphic


@lru_cache(maxsize=1)
def _named_polynomials() -> tuple[np.ndarray, np.ndarray]:
    """Exponents (i, j) of x^i y^j, and the coefficients (terms, x and y, powers).

    Solved for at as many random points as make it well-posed, and rounded.
    """
    exponents = np.array([(n - j, j) for n in range(2, 6) for j in range(n + 1)])
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, 200))
    powers = x[:, None] ** exponents[:, 0] * y[:, None] ** exponents[:, 1]
    terms = np.array(_named_terms(x, y, 0 * x))
    found, *_ = np.linalg.lstsq(powers, terms.reshape(-1, len(x)).T)
    return exponents, np.rint(found.T).reshape(len(terms), 2, -1)


@lru_cache(maxsize=32)
def free_degrees(degree: int) -> np.ndarray:
    """(i, j) of every Chebyshev product of a free field, lowest total degree first."""
    pairs = [
        (n - j, j) for n in range(LOWEST_FREE_DEGREE, degree + 1) for j in range(n + 1)
    ]
    return np.array(pairs, int).reshape(-1, 2)


def free_basis(
    q: Float[Array, "2"], box: Float[Array, "2 2"], degree: int
) -> Float[Array, " terms"]:
    """T_i(x) T_j(y) on the box (low corner, high corner), clamped at its border."""
    if degree < LOWEST_FREE_DEGREE:
        return jnp.zeros(0, q.dtype)
    low, high = box[0], box[1]
    unit = jnp.clip(2 * (q - low) / (high - low) - 1, -1.0, 1.0)
    pairs = free_degrees(degree)
    chebyshev = _chebyshev(unit, degree)
    return chebyshev[pairs[:, 0], 0] * chebyshev[pairs[:, 1], 1]


def _chebyshev(unit: Float[Array, "2"], degree: int) -> Float[Array, "degrees 2"]:
    """T_0 ... T_degree of each coordinate, stacked first."""
    rows = [jnp.ones_like(unit), unit]
    for _ in range(2, degree + 1):
        rows.append(2 * unit * rows[-1] - rows[-2])
    return jnp.stack(rows[: degree + 1])


def displacement(
    q: Float[Array, "2"],
    named: Float[Array, " named"],
    free: Float[Array, "2 terms"],
    box: Float[Array, "2 2"],
    degree: int,
) -> Float[Array, "2"]:
    """d(q), held below the gradient at which the map could fold.

    Parameters
    ----------
    q : Point, in reference radii from the principal point.
    named, free : Coefficients of `named_basis` and `free_basis`.
    box : Low and high corner of what was photographed, from the principal point too.
    degree : Total degree of the free field.
    """
    guard = fold_guard(named, free, box, degree)
    return _unguarded_displacement(degree, q, named, free, box) * guard


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _unguarded_displacement(
    degree: int, q: Array, named: Array, free: Array, box: Array
) -> Array:
    return with_basis(degree, q, named, free, box)[0]


@_unguarded_displacement.defjvp
def _unguarded_derivative(degree, primals, tangents):
    """Linear in the coefficients; along q by one 2 x 2 matrix for all tangents."""
    q, named, free, box = primals
    q_dot, named_dot, free_dot, box_dot = tangents
    value, _, free_at = with_basis(degree, q, named, free, box)
    # A box moves as a whole, with the principal point: only its corner's shift counts.
    at_q, at_box = jax.jacfwd(
        lambda p, b: with_basis(degree, p, named, free, box + b[None])[0], (0, 1)
    )(q, jnp.zeros_like(q))
    change = at_q @ q_dot + at_box @ box_dot[0]
    named_change = _named_displacement(jnp.clip(q, box[0], box[1]), named_dot)
    return value, change + named_change + free_dot @ free_at


def with_basis(
    degree: int,
    q: Float[Array, "2"],
    named: Float[Array, " named"],
    free: Float[Array, "2 terms"],
    box: Float[Array, "2 2"],
) -> tuple[Float[Array, "2"], Float[Array, "named 2"], Float[Array, " terms"]]:
    """The displacement without its guard, and its value per unit of coefficient."""
    inside = jnp.clip(q, box[0], box[1])
    free_at = free_basis(q, box, degree)
    value = _named_displacement(inside, named) + free @ free_at
    return value, named_basis(inside), free_at


def fold_guard(
    named: Float[Array, " named"],
    free: Float[Array, "2 terms"],
    box: Float[Array, "2 2"],
    degree: int,
) -> Float[Array, ""]:
    """Factor <= 1 on all coefficients that keeps the gradient below `MAX_GRADIENT`.

    The tenth power makes it 1 to rounding for the displacements of real lenses.
    """
    bound = jnp.sum(jnp.abs(named) * _named_gradient_bound(box))
    if degree >= LOWEST_FREE_DEGREE:
        half = (box[1] - box[0]) / 2
        pairs = jnp.asarray(free_degrees(degree) ** 2, half.dtype)
        steepness = jnp.hypot(pairs[:, 0] / half[0], pairs[:, 1] / half[1])
        size = jnp.sqrt(jnp.sum(free**2, 0) + 1e-300)
        bound = bound + jnp.sum(size * steepness)
    return (1 + (bound / MAX_GRADIENT) ** 10) ** -0.1


def _named_gradient_bound(box: Float[Array, "2 2"]) -> Float[Array, " named"]:
    """Largest gradient norm of each named term over the box, from its border.

    Every component is a homogeneous polynomial whose gradient grows outwards, so the
    extremum lies on the border; 64 samples and 10 % cover what lies between them.
    The box is data, never fitted: no derivative is wanted through it.
    """
    t = jnp.linspace(0.0, 1.0, 16, dtype=box.dtype)
    low, high = jax.lax.stop_gradient(box[0]), jax.lax.stop_gradient(box[1])
    across = low[0] + t * (high[0] - low[0])
    along = low[1] + t * (high[1] - low[1])
    full = jnp.ones_like(t)
    border = jnp.concatenate(
        [
            jnp.stack([across, full * low[1]], -1),
            jnp.stack([across, full * high[1]], -1),
            jnp.stack([full * low[0], along], -1),
            jnp.stack([full * high[0], along], -1),
        ]
    )
    jacobian = _named_gradients(border)
    return 1.1 * jnp.max(jnp.sqrt(jnp.sum(jacobian**2, (-2, -1))), axis=0)


def _named_gradients(q: Float[Array, "points 2"]) -> Float[Array, "points terms 2 2"]:
    """d `named_basis` / d q, as polynomials: JAX's own derivative of every product
    would be a large part of each program that has a distortion in it, and take as
    large a part of the time to compile it."""
    exponents, coefficients = _named_polynomials()
    powers = [jnp.ones_like(q)]
    for _ in range(exponents.max()):
        powers.append(powers[-1] * q)
    power = jnp.stack(powers)
    lower = np.maximum(exponents - 1, 0)
    by_x = power[lower[:, 0], :, 0] * power[exponents[:, 1], :, 1]
    by_y = power[exponents[:, 0], :, 0] * power[lower[:, 1], :, 1]
    factors = coefficients[..., None] * exponents  # of the lowered powers
    slopes = jnp.stack([by_x, by_y])
    return jnp.einsum("tcka,akp->ptca", jnp.asarray(factors, q.dtype), slopes)

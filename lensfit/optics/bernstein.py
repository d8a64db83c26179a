"""Bernstein polynomials over [0, 1], but for the one that is 1 at 0.

Reference: G. Farin, Curves and Surfaces for CAGD (2002), ch. 5.
"""

from math import comb
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

_Values = TypeVar("_Values", bound=Any)
"""An array of NumPy or of JAX: presets are read and blended without JAX."""


def bernstein(
    s: Float[_Values, "*points"], degree: int
) -> Float[_Values, "*points terms"]:
    """B_1,n ... B_n,n at s."""
    # Integer powers: the derivative of 0.0**0.0 is NaN, at the axis and at the edge.
    terms = [
        comb(degree, k) * s**k * (1 - s) ** (degree - k) for k in range(1, degree + 1)
    ]
    return s.__array_namespace__().stack(terms, axis=-1)


def continued_bernstein(
    s: Float[_Values, "*points"], degree: int
) -> Float[_Values, "*points terms"]:
    """The same, and beyond 1 the straight lines that go on as they end."""
    xp = s.__array_namespace__()
    last = np.eye(degree)[-1] - (np.eye(degree)[-2] if degree > 1 else 0.0)
    beyond = xp.maximum(s - 1.0, 0.0)
    inside = bernstein(xp.minimum(s, 1.0), degree)
    return inside + degree * beyond[..., None] * xp.asarray(last, dtype=s.dtype)

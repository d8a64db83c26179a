"""Convert numbers for JSON: NaN to null, and an infinite distance to "inf"."""

import math

import numpy as np
from jaxtyping import ArrayLike


def plain(value: float | None) -> float | None:
    """The number; None where it is not known."""
    return None if value is None or not math.isfinite(value) else float(value)


def plain_distance(value: float | None) -> float | str | None:
    """A distance, which may be infinite."""
    return "inf" if value is not None and math.isinf(value) else value


def distance_of(plain_mm: float | str | None) -> float | None:
    """The distance that `plain_distance` wrote."""
    return None if plain_mm is None else float(plain_mm)


def rounded(values: ArrayLike, digits: int) -> list[float | None]:
    """Each of (values,) to so many decimals; None where it is not finite."""
    return [
        round(float(v), digits) if np.isfinite(v) else None for v in np.asarray(values)
    ]

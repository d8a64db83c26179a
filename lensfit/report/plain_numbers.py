"""Plain numbers: for JSON, NaN as null and infinity as "inf"; round for scale bars."""

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


def rounded_numbers(values: ArrayLike, digits: int) -> list[float | None]:
    """Each of (values,) to so many decimals; None where it is not finite."""
    return [
        round(float(v), digits) if np.isfinite(v) else None for v in np.asarray(values)
    ]


def round_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten that is not below a positive value."""
    if not value > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (1, 2, 5, 10) if m * power >= value * (1 - 1e-9))

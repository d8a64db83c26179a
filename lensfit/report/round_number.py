"""Round numbers for scale bars and enlargements."""

import math


def round_up(value: float) -> float:
    """The next of 1, 2, 5 times a power of ten that is not below a positive value."""
    if not value > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(m * power for m in (1, 2, 5, 10) if m * power >= value * (1 - 1e-9))

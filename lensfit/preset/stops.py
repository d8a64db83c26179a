"""What each f-number on the barrel really opens, as a function of the f-number.

Between the stops that were photographed the logarithm of the ratio is linear in the
logarithm of the f-number; beyond them it stays what it is at the nearest.
"""

import math

from lensfit.preset.blur_blocks import Stop


def radius_ratio(stops: tuple[Stop, ...], f_number: float) -> float:
    """Radius of the stop over the one that the f-number says; 1 where none is known."""
    known = sorted((stop.f_number, stop.radius_ratio) for stop in stops)
    if not known:
        return 1.0
    below = [stop for stop in known if stop[0] <= f_number] or known[:1]
    above = [stop for stop in known if stop[0] >= f_number] or known[-1:]
    (low, first), (high, second) = below[-1], above[0]
    if low == high:
        return first
    weight = math.log(f_number / low) / math.log(high / low)
    return math.exp((1 - weight) * math.log(first) + weight * math.log(second))


def blended_stops(
    first: tuple[Stop, ...], second: tuple[Stop, ...], weight: float
) -> tuple[Stop, ...]:
    """The mean of both functions, at every f-number that one of them knows."""
    numbers = sorted({stop.f_number for stop in (*first, *second)})
    return tuple(
        Stop(
            number,
            (1 - weight) * radius_ratio(first, number)
            + weight * radius_ratio(second, number),
        )
        for number in numbers
    )

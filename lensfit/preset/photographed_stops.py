"""The real stop radius at each f-number of the barrel, as a function of the f-number.

Between the stops that were photographed the logarithm of the ratio is linear in the
logarithm of the f-number; beyond them it stays what it is at the nearest. A note says
how far the f-number lies beyond them (`unphotographed_f_number_note`).
"""

import math

from lensfit.preset.blocks import Stop

SAME_STOP = 1.05
"""Ratio of f-numbers up to which they are one: 5.6 to 8 is no exact stop either."""
_ONE_STOP = math.sqrt(2)


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


def unphotographed_f_number_note(
    stops: tuple[Stop, ...], f_number: float
) -> tuple[str, ...]:
    """What to note of blur at an f-number outside those that it was photographed at.

    Nothing between them or at them, up to a stop farther down, or where none is known.
    The sentence is the same for every f-number, so that a pulled stop gives one note.
    """
    known = sorted(stop.f_number for stop in stops)
    if known and f_number * SAME_STOP < known[0]:
        return (
            f"the blur wider open than f/{known[0]:.3g}, the widest f-number it was "
            "photographed at, is the model's prediction: its aberrations are "
            "extrapolated to the rim of the wider pupil",
        )
    if known and f_number > _ONE_STOP * SAME_STOP * known[-1]:
        return (
            f"the blur more than a stop beyond f/{known[-1]:.3g}, the narrowest stop "
            "it was photographed at, is the model's prediction",
        )
    return ()


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

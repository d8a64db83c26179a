"""The slot `custom` of OpenTrackIO's lens, for what the standard has no field for.

lensfit writes, where the calibration history says "custom: lensfit layout 1",

    [1, nominal focal length mm, focus dioptres (0 infinite, -1 unknown)]

and, for a lens with lateral colour, for red and then for blue: reference radius mm,
largest measured radius, shift x and y mm, two strains, two decenterings, the number
of radial coefficients and these (`lensfit.optics.lateral` has the formula).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lensfit.errors import ExchangeError
from lensfit.preset.exchange.opentrackio_sample import ColourShift, LensSample
from lensfit.preset.exchange.text_file import positive
from lensfit.units import MILLIMETRES_PER_METRE, dioptres_from_mm

CUSTOM_MARK = "custom: lensfit layout 1"
_LAYOUT = 1.0
_UNKNOWN = -1.0
_HEAD_OF_SHIFT = 9
"""Numbers of a channel before its radial coefficients."""


def custom_numbers(sample: LensSample) -> Iterator[float]:
    """What lensfit writes into `custom`."""
    focus = sample.focus_distance_mm
    yield _LAYOUT
    yield sample.nominal_focal_length_mm or sample.pinhole_focal_length_mm
    yield _UNKNOWN if focus is None else dioptres_from_mm(focus)
    for channel in "rb" if sample.colour else "":
        shift = sample.colour[channel]
        yield shift.reference_radius_mm
        yield shift.valid_radius
        yield from (*shift.shift_mm, *shift.strain, *shift.decentering)
        yield float(len(shift.radial))
        yield from shift.radial


@dataclass(frozen=True)
class Custom:
    """What lensfit keeps in `custom`.

    Attributes
    ----------
    nominal_mm : Focal length as on the barrel.
    focus_mm : Focus distance; may be infinite, None when not known.
    colour : "r" and "b", or empty.
    """

    nominal_mm: float
    focus_mm: float | None
    colour: dict[str, ColourShift]


def custom_of_numbers(numbers: tuple[float, ...], path: Path) -> Custom | None:
    """What the numbers of `custom` say; None of another layout.

    Raises
    ------
    ExchangeError : They are of this layout, and hold what cannot be.
    """
    if len(numbers) < 3 or numbers[0] != _LAYOUT:
        return None
    nominal, dioptres = positive(numbers[1], "custom[1]", path), numbers[2]
    focus = None
    if dioptres >= 0:
        focus = MILLIMETRES_PER_METRE / dioptres if dioptres else math.inf
    colour, rest = {}, numbers[3:]
    for channel in "rb" if rest else "":
        head, count = rest[:_HEAD_OF_SHIFT], 0
        if len(head) == _HEAD_OF_SHIFT:
            count = int(head[-1]) if 0 <= head[-1] < 100 else len(rest)
        end = _HEAD_OF_SHIFT + count
        if len(head) < _HEAD_OF_SHIFT or len(rest) < end or min(head[:2]) <= 0:
            raise ExchangeError("custom is no lateral colour of lensfit", where=path)
        colour[channel] = ColourShift(
            head[0],
            head[1],
            (head[2], head[3]),
            (head[4], head[5]),
            (head[6], head[7]),
            rest[_HEAD_OF_SHIFT:end],
        )
        rest = rest[end:]
    return Custom(nominal, focus, colour)

"""Read text files of other programs within bounds; a wrong file is one error line.

A lens file is kilobytes. What is larger than `LARGEST_BYTES`, no ordinary file, or no
text is refused before it is parsed; numbers must be finite.
"""

import math
from collections.abc import Sequence
from pathlib import Path

from lensfit.bounded import read_bounded, utf8_text
from lensfit.errors import ExchangeError

LARGEST_BYTES = 4 << 20
_LARGEST_SIDE_PX = 100_000


def read_text(path: str | Path, kind: str) -> str:
    """The text of a file.

    Parameters
    ----------
    kind : What it should be, for messages, such as "OpenCV calibration".

    Raises
    ------
    ExchangeError : It cannot be read, is too large, or is no UTF-8 text.
    """
    path, remedy = Path(path), f"give the {kind}"
    content = read_bounded(
        path,
        LARGEST_BYTES,
        error=ExchangeError,
        remedy=remedy,
        too_large="give the file of one lens",
    )
    return utf8_text(content, path, error=ExchangeError, remedy=remedy)


def finite_number(value: object, what: str, where: str | Path) -> float:
    """A number of a file, given as text or as a number.

    Raises
    ------
    ExchangeError : It is no finite number.
    """
    try:
        if isinstance(value, bool) or not isinstance(value, (str, int, float)):
            raise ValueError
        number = float(value)
    except (ValueError, OverflowError):
        raise ExchangeError(
            f"{what} = {_short(value)} is no number", where=where
        ) from None
    if not math.isfinite(number):
        raise ExchangeError(f"{what} = {_short(value)} is not finite", where=where)
    return number


def positive_number(value: object, what: str, where: str | Path) -> float:
    """A `finite_number` above zero.

    Raises
    ------
    ExchangeError : It is none.
    """
    number = finite_number(value, what, where)
    if not number > 0:
        raise ExchangeError(f"{what} = {number:g} is not positive", where=where)
    return number


def picture_size(
    sides: Sequence[float], name: str, where: str | Path
) -> tuple[int, int]:
    """Width and height of a picture in pixels.

    Raises
    ------
    ExchangeError : They are none, or beyond any picture.
    """
    if len(sides) != 2 or not all(
        0 < n < _LARGEST_SIDE_PX and n % 1 == 0 for n in sides
    ):
        raise ExchangeError(f"{name} is no size in pixels", where=where)
    return int(sides[0]), int(sides[1])


def _short(value: object) -> str:
    text = str(value) if isinstance(value, (str, float)) else type(value).__name__
    return text if len(text) <= 40 else text[:37] + "..."

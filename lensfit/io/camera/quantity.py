"""The quantities of a camera, and the numbers that stand for an unknown value.

Every quantity carries its unit in its name. Sidecars write 0 for what they do not know,
or one of a few marks; both count as unknown here.
"""

import math
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

from lensfit.errors import CameraError
from lensfit.units import MILLIMETRES_PER_INCH, MILLIMETRES_PER_METRE

TEXTS = ("camera_model", "lens_model", "lens_serial")
LARGEST: dict[str, float] = {
    "focal_length_mm": 1e5,
    "pinhole_focal_length_mm": 1e5,
    "f_number": 1e3,
    "t_number": 1e3,
    "focus_distance_mm": math.inf,
    "focus_from_pupil_mm": math.inf,
    "sensor_width_mm": 1e4,
    "sensor_height_mm": 1e4,
    "overscan_percent": 1e3,
    "vertical_fov_deg": 179.9,
}
"""Numbers that a camera file or a settings file may give, and what none exceeds."""

LENGTHS_MM = {
    "mm": 1.0,
    "cm": 10.0,
    "m": MILLIMETRES_PER_METRE,
    "in": MILLIMETRES_PER_INCH,
    "ft": 12 * MILLIMETRES_PER_INCH,
}
_SPELT = {
    "meter": "m",
    "meters": "m",
    "metre": "m",
    "metres": "m",
    "millimeter": "mm",
    "millimetre": "mm",
    "centimeter": "cm",
    "centimetre": "cm",
    "inch": "in",
    "inches": "in",
    "foot": "ft",
    "feet": "ft",
}
_MISSING = {"", "-", "--", "---", "n.a.", "n/a", "na", "none", "null", "unknown"}


class Reading(NamedTuple):
    """A value, in the unit of its quantity, and the column or knob that gave it."""

    value: float | str
    entry: str


def is_missing(text: str) -> bool:
    """Whether a cell says that its writer did not know."""
    return text.strip().lower() in _MISSING


def unit_mm(text: str, entry: str) -> float:
    """Millimetres of a unit of length.

    Raises
    ------
    CameraError : The unit is unknown.
    """
    word = text.strip().lower()
    unit = LENGTHS_MM.get(_SPELT.get(word, word))
    if unit is None:
        raise CameraError(
            f"{entry} is {_quoted_text(text)}, which is no known unit of length",
            remedy=f"lensfit knows {', '.join(LENGTHS_MM)}",
        )
    return unit


def number(text: str, entry: str) -> float:
    """The number in a cell; fractions such as 180/10 are welcome.

    Raises
    ------
    CameraError : There is none, or it is NaN.
    """
    word = text.strip()
    try:
        if len(word) > 64:
            raise ValueError
        value = float(Fraction(word)) if "/" in word else float(word)
    except (ValueError, ArithmeticError):
        raise CameraError(
            f"{entry} is {_quoted_text(text)} and should be a number"
        ) from None
    if math.isnan(value):
        raise CameraError(f"{entry} is NaN and should be a number")
    return value


def checked_quantity(name: str, value: float, entry: str) -> float | None:
    """A number as a quantity; None for zero, which means that it is not known.

    Raises
    ------
    CameraError : It is negative, infinite or beyond anything built.
    """
    if value == 0:
        return None
    most = LARGEST[name]
    if not 0 < value <= most or (math.isinf(value) and not math.isinf(most)):
        raise CameraError(
            f"{entry} is {value:g}, which is no {quantity_name(name)}",
            remedy="mend it, or state the value yourself",
        )
    return float(f"{value:.9g}")


def quantity_name(name: str) -> str:
    """A quantity in words: focal_length_mm is "focal length in mm"."""
    if name.endswith("_number"):
        return name.replace("_", "-")
    words = name.split("_")
    return f"{' '.join(words[:-1])} in {words[-1]}"


def error_at_line(error: CameraError, path: Path, line: int | str) -> CameraError:
    """The error with the place in its file."""
    place = f"line {line}" if isinstance(line, int) else line
    return CameraError(f"{place}: {error.what}", where=path, remedy=error.remedy)


def _quoted_text(text: str) -> str:
    return repr(" ".join(text.split())[:40])

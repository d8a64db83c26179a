"""The quantities of a camera, and how cameras and crews write them.

Every quantity carries its unit in its name. Sidecars write 0 for what they do not know,
or one of a few marks; both count as unknown here.

Cameras write a stop as "1.4 + 7/10", "T 2 3/10", "T2.3" or "F5.6": a number as
engraved, and tenths (or thirds) of a stop that the iris is closed beyond it; each stop
is a factor of sqrt 2. T-stops count transmitted light and are a little larger than the
f-number, which counts geometry.

Crews write a length as 4'11", 59 1/2 in, 1.5 m, 150 cm or inf. Feet and inches are
those of the tape measure: after feet, inches are below twelve; a fraction follows its
whole number after a space.
"""

import math
import re
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


_STOP = re.compile(
    r"\s*(?P<kind>[TtFf])?\s*/?\s*(?P<mark>\d+(?:\.\d+)?|\.\d+)"
    r"(?:\s*\+?\s+(?P<top>\d{1,3})\s*/\s*(?P<bottom>\d{1,3}))?\s*"
)


def stop(text: str, entry: str) -> tuple[str | None, float]:
    """The letter of a stop, "T", "F" or None, and its number.

    Raises
    ------
    CameraError : The text is no stop.
    """
    match = _STOP.fullmatch(text) if len(text) < 64 else None
    if match is None or match["bottom"] == "0":
        shown = " ".join(text.split())[:40]
        raise CameraError(f"{entry} is {shown!r} and should be a stop, such as T2.8")
    closed = int(match["top"]) / int(match["bottom"]) if match["top"] else 0.0
    kind = match["kind"]
    return kind and kind.upper(), float(match["mark"]) * 2 ** (closed / 2)


def stop_of_linear_iris(value: float) -> float:
    """T-stop of ARRI's linear iris: 1000 is T1, and every 1000 more closes a stop."""
    return 2 ** (min(max(value, -1e5), 1e5) / 2000 - 0.5)


_NUMBER = r"\d+(?:\.\d+)?|\.\d+"
_INCHES = rf"(?:(?P<inches>{_NUMBER})(?:\s+(?P<over>\d+)/(?P<under>\d+))?)"
_FEET = re.compile(
    rf"(?P<feet>{_NUMBER})\s*(?:'|’|′|ft\b|feet\b|foot\b)\s*"
    rf"(?:{_INCHES}\s*(?:\"|''|”|″|in\b|inch\b|inches\b)?)?"
)
_ONLY_INCHES = re.compile(rf"{_INCHES}\s*(?:\"|''|”|″|in|inch|inches)")
_METRIC = re.compile(rf"(?P<number>{_NUMBER})\s*(?P<unit>[A-Za-z]+)")
_INFINITE = ("inf", "infinity", "∞")
_INCHES_PER_FOOT = 12
_REMEDY = "write 4'11\", 59 in, 1.5 m, 150 cm or 1500 mm"


def written_length_mm(text: str, entry: str) -> float:
    """Millimetres of a length that names its unit; may be infinite.

    Parameters
    ----------
    text : As written.
    entry : Whose value it is, for the message.

    Raises
    ------
    CameraError : It is no length, names no unit, or has twelve inches after feet.
    """
    word = text.strip()
    if word.lower() in _INFINITE:
        return math.inf
    found = _FEET.fullmatch(word)
    if found:
        inches = _inches(found)
        if inches >= _INCHES_PER_FOOT:
            raise CameraError(
                f"{entry} = {text!r} has {inches:g} inches after its feet",
                remedy="inches are below 12 there",
            )
        feet = float(found["feet"])
        return (_INCHES_PER_FOOT * feet + inches) * MILLIMETRES_PER_INCH
    found = _ONLY_INCHES.fullmatch(word)
    if found:
        return _inches(found) * MILLIMETRES_PER_INCH
    found = _METRIC.fullmatch(word)
    if found is None:
        raise CameraError(f"{entry} = {text!r} is no length", remedy=_REMEDY)
    try:
        return float(found["number"]) * unit_mm(found["unit"], entry)
    except CameraError as error:
        raise CameraError(error.what, remedy=_REMEDY) from error


def _inches(found: re.Match[str]) -> float:
    whole = float(found["inches"] or 0)
    if found["over"] is None:
        return whole
    under = int(found["under"])
    return whole + (int(found["over"]) / under if under else math.inf)

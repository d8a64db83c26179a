"""Lengths as crews write them: 4'11", 59 1/2 in, 1.5 m, 150 cm, inf.

Feet and inches are those of the tape measure: after feet, inches are below twelve; a
fraction follows its whole number after a space.
"""

import math
import re

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import unit_mm
from lensfit.units import MILLIMETRES_PER_INCH

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

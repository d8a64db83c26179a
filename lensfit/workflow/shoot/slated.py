"""What a camera report says of a photograph, as values of a shoot file.

A cell is text that a person typed: ``T2.8``, ``50mm``, ``4'11"``. A stop with a T in
front of it is a T-stop in whatever column it stands, and one with an f is none. A bare
number is a focal length in millimetres, but no distance: feet, metres and millimetres
are all usual, so its unit must be said.
"""

import re
from collections.abc import Mapping

from lensfit.errors import ShootError
from lensfit.io.camera.slates import Slate
from lensfit.workflow.shoot.lengths import length_mm

_STOP = re.compile(r"(?P<kind>[TtFf]?)\s*/?\s*(?P<number>\d+(?:\.\d+)?)")
_NUMBER = re.compile(r"\d+(?:\.\d+)?")
_TEXTS = ("lens_model", "lens_serial")


def slated_values(slate: Slate) -> Mapping[str, float | str]:
    """The quantities of a row, in the units of a shoot file.

    Raises
    ------
    ShootError : A cell holds no such quantity, or a distance without a unit; the line
        of the report is named.
    """
    values: dict[str, float | str] = {}
    for quantity, text in slate.values.items():
        if quantity in _TEXTS:
            values[quantity] = text
        elif quantity in ("f_number", "t_number"):
            found = _STOP.fullmatch(text)
            if found is None:
                raise _wrong(slate, quantity, text, "write T2.8, f/2.8 or 2.8")
            kind = {"t": "t_number", "f": "f_number"}.get(found["kind"].lower())
            values[kind or quantity] = float(found["number"])
        elif quantity == "focal_length_mm" and _NUMBER.fullmatch(text):
            values[quantity] = float(text)
        elif _NUMBER.fullmatch(text):
            raise _wrong(slate, quantity, text, "say its unit: 4'11\", 1.5 m, 1500 mm")
        else:
            values[quantity] = length_mm(text, quantity, slate.place)
    return values


def _wrong(slate: Slate, quantity: str, text: str, remedy: str) -> ShootError:
    name = quantity.removesuffix("_mm").replace("_", " ")
    return ShootError(f"{text!r} is no {name}", where=slate.place, remedy=remedy)

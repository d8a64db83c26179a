"""Header attributes that are written: in OpenEXR's types, and those of a lens.

Read attributes come back in the binding's own types and are passed on untouched.
Attributes made in Python or NumPy are brought to the nearest EXR type here, and what
has none is refused by name: the binding itself drops a list of integers silently.
Types: https://openexr.com/en/latest/OpenEXRFileLayout.html

The standard's attributes of a lens have the standard's units: millimetres for lengths
of the lens, metres for the focus distance. ``nominalFocalLength`` is the barrel's
number, ``pinholeFocalLength`` that of the pinhole with the same angle of view near the
axis, ``entrancePupilOffset`` counts from the image plane towards the scene. Those of
the sensor describe the whole of it and its photosites, which a lens does not know.

References
----------
OpenEXR 3.2, "Standard Attributes", and ImfStandardAttributes.h.
"""

from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np
import OpenEXR

from lensfit.coords import Window
from lensfit.errors import OutputError
from lensfit.units import m_from_mm

_INT32 = range(-(2**31), 2**31)


def attributes_for_writing(
    attributes: Mapping[str, object], where: str | Path
) -> dict[str, object]:
    """Attributes as the binding takes them.

    Parameters
    ----------
    attributes : Name to value. Python and NumPy numbers, strings, `Fraction`, `Window`,
        arrays of 2 or 3 numbers or 3 x 3 or 4 x 4, lists of strings or of floats,
        and the binding's own types.
    where : The file they are for, named in errors.

    Raises
    ------
    OutputError : A value has no OpenEXR type.
    """
    return {name: _writable(name, value, where) for name, value in attributes.items()}


def _writable(name: str, value: object, where: str | Path) -> object:
    # A function takes one level of value apart; what it does not know comes back as is.
    if isinstance(value, Window):
        corners = np.asarray(value, np.int32)
        return corners[:2], corners[2:]
    if isinstance(value, (bool, int, np.bool_, np.integer)) and int(value) in _INT32:
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value)
    if isinstance(value, Fraction):
        if value.numerator in _INT32 and value.denominator in _INT32:
            return value
    elif isinstance(value, list):
        return _writable_list(name, value, where)
    elif isinstance(value, (str, np.ndarray, tuple, *_binding_types())):
        return value
    raise _no_type(name, value, where)


def _writable_list(name: str, value: list, where: str | Path) -> object:
    if not value:
        # The binding cannot tell of what an empty list is a list.
        return OpenEXR.OpaqueAttribute(b"", "stringvector")
    if all(isinstance(item, str) for item in value):
        return value
    if all(isinstance(item, (int, float, np.number)) for item in value):
        return [float(item) for item in value]
    raise _no_type(name, value, where)


def _binding_types() -> tuple[type, ...]:
    names = (
        "Bytes",
        "OpaqueAttribute",
        "KeyCode",
        "TimeCode",
        "PreviewImage",
        "TileDescription",
        "Envmap",
        "LineOrder",
        "Compression",
        "IDManifest",
    )
    return tuple(getattr(OpenEXR, name) for name in names if hasattr(OpenEXR, name))


def _no_type(name: str, value: object, where: str | Path) -> OutputError:
    return OutputError(
        f"attribute {name!r} is a {type(value).__name__}, which OpenEXR cannot store",
        where=where,
        remedy="give it as a number, a string, or a list of either",
    )


def lens_attributes(
    *,
    nominal_focal_length_mm: float | None = None,
    pinhole_focal_length_mm: float | None = None,
    f_number: float | None = None,
    focus_distance_mm: float | None = None,
    entrance_pupil_offset_mm: float | None = None,
    lens_model: str | None = None,
    lens_serial: str | None = None,
) -> dict[str, object]:
    """Attributes of what is known; what is None, or an empty text, has none.

    Parameters
    ----------
    focus_distance_mm : From the sensor; may be infinite.
    """
    focus_m = None if focus_distance_mm is None else m_from_mm(focus_distance_mm)
    found: dict[str, object | None] = {
        "nominalFocalLength": nominal_focal_length_mm,
        "pinholeFocalLength": pinhole_focal_length_mm,
        "aperture": f_number,
        "focus": focus_m,
        "entrancePupilOffset": entrance_pupil_offset_mm,
        "lensModel": lens_model or None,
        "lensSerialNumber": lens_serial or None,
    }
    return {name: value for name, value in found.items() if value is not None}

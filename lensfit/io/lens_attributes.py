"""The lens attributes of the OpenEXR standard, for headers that are written.

Units are the standard's: millimetres for lengths of the lens, metres for the focus
distance. ``nominalFocalLength`` is the barrel's number, ``pinholeFocalLength``
that of the pinhole with the same angle of view near the axis, ``entrancePupilOffset``
counts from the image plane towards the scene. The standard's attributes of the sensor
describe the whole of it and its photosites, which a lens does not know.

References
----------
OpenEXR 3.2, "Standard Attributes", and ImfStandardAttributes.h.
"""

from lensfit.units import m_from_mm


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

"""Lengths in shoot files and reports, as crews write them.

A length says its unit, or its key does (`lensfit.io.camera.quantity`). A focal
length must be possible for the width of its sensor: the shortest fisheyes are a
twentieth as long as their sensor is wide, the longest telescopes a few hundred times as
long. What lies beyond is in metres, or a slip.
"""

from lensfit.errors import CameraError, ShootError
from lensfit.io.camera.quantity import written_length_mm

SHORTEST_WIDTHS, LONGEST_WIDTHS = 1 / 20, 500.0
"""Focal lengths, in widths of the sensor."""


def length_mm(text: str, key: str, where: str) -> float:
    """Millimetres of a length that names its unit.

    Parameters
    ----------
    text : As written.
    key, where : Of the value, for the message.

    Raises
    ------
    ShootError : It is no length, names no unit, or has twelve inches after feet.
    """
    try:
        return written_length_mm(text, key)
    except CameraError as error:
        raise ShootError(error.what, where=where, remedy=error.remedy) from error


def check_focal_length(
    focal_length_mm: float, sensor_width_mm: float, where: str
) -> None:
    """Refuse a focal length that no lens on such a sensor has.

    Raises
    ------
    ShootError : It is far too short or far too long.
    """
    widths = focal_length_mm / sensor_width_mm
    if SHORTEST_WIDTHS <= widths <= LONGEST_WIDTHS:
        return
    much = "short" if widths < 1 else "long"
    raise ShootError(
        f"focal_length_mm = {focal_length_mm:g} is too {much} for a sensor of "
        f"sensor_width_mm = {sensor_width_mm:g}",
        where=where,
        remedy="both are in millimetres",
    )

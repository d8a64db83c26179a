"""Lengths in shoot files and reports, as crews write them.

A length says its unit, or its key does (`lensfit.io.camera.written_length`).
"""

from lensfit.errors import CameraError, ShootError
from lensfit.io.camera.written_length import written_length_mm


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

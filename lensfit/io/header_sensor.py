"""The sensor's size, from header entries that give both its sides.

``sensorPhotositePitch`` and ``sensorAcquisitionRectangle`` (OpenEXR 3.2) give the area
that was recorded. ``sensorOverallDimensions`` is the light-sensitive area of the whole
sensor, independent of that, and no size of the picture. EXIF gives the pixels
per unit on the sensor, or only the focal length that has the same diagonal angle on 36
x 24 mm (CIPA DCG-001), in whole millimetres. Sizes are millimetres, width first.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from lensfit.errors import ImageError
from lensfit.io.camera.header_entries import impossible_value_error, number_in
from lensfit.units import MILLIMETRES_PER_INCH

_DIAGONAL_35MM_MM = math.hypot(36.0, 24.0)
_EXIF_UNIT_MM: dict[object, float] = {
    2: MILLIMETRES_PER_INCH,
    3: 10.0,
    4: 1.0,
    5: 0.001,
}
_EXIF_TURNED = (5, 6, 7, 8)


class SensorSize(NamedTuple):
    """Width and height, and the entries that told them.

    Attributes
    ----------
    size_mm : An error in its place where the entries hold what cannot be.
    """

    size_mm: tuple[float, float] | ImageError
    source: str


RECORDED = ("sensorPhotositePitch", "sensorAcquisitionRectangle")
"""Entries that state the recorded area together."""
WHOLE_SENSOR = "sensorOverallDimensions"


def recorded_size(header: Mapping[str, object]) -> SensorSize | None:
    """The area that was recorded, by the standard's attributes; None if not stated."""
    if not set(RECORDED) <= header.keys():
        return None
    return _size_of_entries(" x ".join(RECORDED), _from_photosites, header, RECORDED)


def whole_sensor_mm(header: Mapping[str, object]) -> tuple[float, float] | None:
    """Width and height of the whole sensor, whatever part of it was recorded; None if
    the header does not state them."""
    if WHOLE_SENSOR not in header:
        return None
    found = _size_of_entries(
        WHOLE_SENSOR, _from_overall_dimensions, header, (WHOLE_SENSOR,)
    )
    return None if isinstance(found.size_mm, ImageError) else found.size_mm


def exif_sizes(
    header: Mapping[str, object],
    size_px: tuple[int, int] | None,
    focal_length_mm: float | None,
) -> list[SensorSize]:
    """By EXIF, the better one first.

    Parameters
    ----------
    size_px : Of the upright picture; nothing is known without it.
    focal_length_mm : That the 35 mm equivalent stands beside.
    """
    if size_px is None:
        return []
    candidates = []
    try:
        candidates.append(_from_focal_plane_resolution(header, size_px))
    except ImageError as error:
        candidates.append(SensorSize(error, "FocalPlaneXResolution"))
    try:
        candidates.append(_from_35mm_equivalent(header, focal_length_mm, size_px))
    except ImageError as error:
        candidates.append(SensorSize(error, "FocalLengthIn35mmFilm"))
    return [candidate for candidate in candidates if candidate is not None]


def _size_of_entries(
    source: str,
    read: Callable[..., tuple[float, float]],
    header: Mapping[str, object],
    keys: tuple[str, ...],
) -> SensorSize:
    try:
        width, height = read(header, *keys)
        if not all(0 < side < math.inf for side in (width, height)):
            raise impossible_value_error(
                source, (width, height), "two lengths above zero"
            )
    except ImageError as error:
        return SensorSize(error, source)
    return SensorSize((float(f"{width:.7g}"), float(f"{height:.7g}")), source)


def _from_photosites(
    header: Mapping[str, object], pitch: str, box: str
) -> tuple[float, float]:
    pitch_mm = number_in(pitch, header[pitch]) / 1000
    try:
        (x_min, y_min), (x_max, y_max) = header[box]  # pyright: ignore
        size = (int(x_max) - int(x_min) + 1, int(y_max) - int(y_min) + 1)
    except (TypeError, ValueError, OverflowError):
        raise impossible_value_error(box, header[box], "a box of photosites") from None
    return pitch_mm * size[0], pitch_mm * size[1]


def _from_overall_dimensions(
    header: Mapping[str, object], key: str
) -> tuple[float, float]:
    try:
        width, height = np.asarray(header[key], float)
        return float(width), float(height)
    except (TypeError, ValueError, OverflowError):
        raise impossible_value_error(key, header[key], "a width and a height") from None


def _from_focal_plane_resolution(
    header: Mapping[str, object], size_px: tuple[int, int]
) -> SensorSize | None:
    """Pixels per unit on the sensor, for the picture as the camera stored it."""
    keys = ("FocalPlaneXResolution", "FocalPlaneYResolution")
    if not set(keys) <= header.keys():
        return None
    unit_mm = _EXIF_UNIT_MM.get(header.get("FocalPlaneResolutionUnit", 2), 25.4)
    pixels_per_mm = [number_in(key, header[key]) / unit_mm for key in keys]
    if not all(0 < p < math.inf for p in pixels_per_mm):
        return None
    turned = header.get("Orientation") in _EXIF_TURNED
    now = size_px[::-1] if turned else size_px
    then = ("ExifImageWidth", "ExifImageHeight")
    stored = [
        number_in(k, header.get(k, n)) or n for k, n in zip(then, now, strict=True)
    ]
    sides = [n / p for n, p in zip(stored, pixels_per_mm, strict=True)]
    if turned:
        sides.reverse()
    return SensorSize(
        (float(f"{sides[0]:.6g}"), float(f"{sides[1]:.6g}")), " ".join(keys)
    )


def _from_35mm_equivalent(
    header: Mapping[str, object],
    focal_length_mm: float | None,
    size_px: tuple[int, int],
) -> SensorSize | None:
    key = "FocalLengthIn35mmFilm"
    if focal_length_mm is None or key not in header:
        return None
    equivalent_mm = number_in(key, header[key])
    if not 0 < equivalent_mm < math.inf:
        return None
    diagonal_mm = _DIAGONAL_35MM_MM * focal_length_mm / equivalent_mm
    scale = diagonal_mm / math.hypot(*size_px)
    width, height = (float(f"{scale * side:.4g}") for side in size_px)
    return SensorSize((width, height), key)

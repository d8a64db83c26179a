"""The camera state in a header: focal length, stop, focus, sensor.

`lensfit.io.camera.header_entries` names every header entry that is understood, and a
settings file may name more. A header may state a quantity twice; the better entry
counts, and the others are kept, since they may contradict it.

Focus distances in headers are metres, for the standard ``focus`` and for ``lens/focus``
alike. ``lens/aperture`` is the horizontal sensor size; the standard ``aperture`` is the
f-number. EXIF writes 0 for what it does not know, which counts as missing here.

Some entries give both sides of the sensor. ``sensorPhotositePitch`` and
``sensorAcquisitionRectangle`` (OpenEXR 3.2) give the area that was recorded.
``sensorOverallDimensions`` is the light-sensitive area of the whole sensor, independent
of that, and no size of the picture. EXIF gives the pixels per unit on the sensor, or
only the focal length that has the same diagonal angle on 36 x 24 mm (CIPA DCG-001), in
whole millimetres. Sizes are millimetres, width first.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np

from lensfit.errors import ImageError
from lensfit.io.camera.header_entries import (
    ALIASES,
    Alias,
    entry_quantity,
    entry_text,
    impossible_value_error,
    is_entry_of_alias,
    number_in,
)
from lensfit.io.camera.quantity import TEXTS
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


@dataclass(frozen=True)
class CameraState:
    """The camera as a header knows it; None where it says nothing.

    Attributes
    ----------
    t_number : T-stop: the f-number of a lens without losses that lets as much through.
    focus_distance_mm : Focus distance; infinity is allowed.
    sensor_width_mm, sensor_height_mm : The area the picture covers.
    overscan_percent : Rendered beyond the frame, in total, percent of its size.
    sources : For each field that is known, the header entries it came from.
    """

    focal_length_mm: float | None = None
    f_number: float | None = None
    focus_distance_mm: float | None = None
    sensor_width_mm: float | None = None
    sensor_height_mm: float | None = None
    overscan_percent: float | None = None
    t_number: float | None = None
    camera_model: str | None = None
    lens_model: str | None = None
    lens_serial: str | None = None
    sources: Mapping[str, str] = field(default_factory=dict)

    def known(self) -> dict[str, float | str]:
        """The fields that are known, by name, without their sources."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return {k: v for k, v in values.items() if v is not None and k != "sources"}


class HeaderWord(NamedTuple):
    """What one entry (or a few together) says of a quantity.

    Attributes
    ----------
    value : In the unit of its quantity; an error where the entry holds something
        impossible.
    entry : Its name.
    of_pinhole : A focal length of the pinhole, as `Alias.of_pinhole`.
    """

    value: float | str | ImageError
    entry: str
    of_pinhole: bool = False


def camera_words(
    header: Mapping[str, object],
    size_px: tuple[int, int] | None = None,
    aliases: Mapping[str, Sequence[Alias]] | None = None,
) -> dict[str, list[HeaderWord]]:
    """All that a header says of a camera, by field of `CameraState`; of each the entry
    that counts most first, the impossible ones among them.

    Parameters
    ----------
    header : Entries by name, of an EXR file or EXIF.
    size_px : Width and height of the upright picture, pixels; needed to turn EXIF's
        resolution on the sensor, or its 35 mm equivalent, into a sensor size.
    aliases : More entries, by field; they count before the built-in ones.
    """
    own = aliases or {}
    words = {
        name: _values_of_entries(header, name, (*own.get(name, ()), *built_in))
        for name, built_in in ALIASES.items()
    }
    focal = next((w.value for w in words["focal_length_mm"] if _is_good(w)), None)
    exif = exif_sizes(header, size_px, focal if isinstance(focal, float) else None)
    recorded = recorded_size(header)
    sizes = [*([] if recorded is None else [recorded]), *exif]
    widths = words["sensor_width_mm"]
    stated = len(
        _values_of_entries(header, "sensor_width_mm", own.get("sensor_width_mm", ()))
    )
    middle = len(sizes) - len(exif)
    words["sensor_width_mm"] = [
        *widths[:stated],
        *_sides(sizes[:middle], 0),
        *widths[stated:],
        *_sides(exif, 0),
    ]
    words["sensor_height_mm"] = _heights(
        words["sensor_height_mm"], words["sensor_width_mm"], sizes
    )
    return {name: found for name, found in words.items() if found}


def camera_state_from(
    header: Mapping[str, object],
    size_px: tuple[int, int] | None = None,
) -> CameraState:
    """The camera state that a header describes.

    Parameters
    ----------
    header, size_px : As `camera_words` takes them.

    Raises
    ------
    ImageError : An entry that counts holds something impossible, like a focal length
        that is no number or not above zero; the error names it.
    """
    values: dict[str, float | str] = {}
    sources: dict[str, str] = {}
    for name, words in camera_words(header, size_px).items():
        value, entry, _ = words[0]
        if isinstance(value, ImageError):
            raise value
        values[name], sources[name] = value, entry
    return CameraState(**values, sources=sources)  # pyright: ignore[reportArgumentType]


def _is_good(word: HeaderWord) -> bool:
    return not isinstance(word.value, ImageError)


def _values_of_entries(
    header: Mapping[str, object], name: str, aliases: Iterable[Alias]
) -> list[HeaderWord]:
    """Every entry that one of the aliases is_entry_of_alias; none of them twice."""
    found: dict[str, HeaderWord] = {}
    for alias in aliases:
        for key, value in header.items():
            if key in found or not is_entry_of_alias(key, alias.key):
                continue
            try:
                text = name in TEXTS
                known = (
                    entry_text(value)
                    if text
                    else entry_quantity(name, key, value, alias)
                )
            except ImageError as error:
                known = error
            if known is not None:
                found[key] = HeaderWord(known, key, alias.of_pinhole)
    return list(found.values())


def _sides(sizes: Iterable[SensorSize], side: int) -> list[HeaderWord]:
    return [
        HeaderWord(size if isinstance(size, ImageError) else size[side], source)
        for size, source in sizes
    ]


def _heights(
    stated: list[HeaderWord], widths: list[HeaderWord], sizes: list[SensorSize]
) -> list[HeaderWord]:
    """Heights: the one of the size whose width counts stands first, and a size whose
    width does not count tells no height that would."""
    best = next((w.entry for w in widths if _is_good(w)), None)
    first = [size for size in sizes if size.source == best]
    others = [
        size
        for size in sizes
        if size.source != best and not isinstance(size.size_mm, ImageError)
    ]
    heights = [*_sides(first, 1), *stated]
    return [*heights, *_sides(others, 1)] if heights else []

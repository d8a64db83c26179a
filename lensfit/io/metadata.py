"""What a header says about the camera: focal length, stop, focus, sensor.

`lensfit.io.camera.aliases` names every header entry that is understood, and a settings
file may name more. Numbers may be strings. Names with a slash may have any prefix (Nuke
shows ``exr/lens/focal``), others only ``exr/``, so that a renderer's own ``aperture``
is not taken for the standard one.

Focus distances in headers are metres, for the standard ``focus`` and for ``lens/focus``
alike. ``lens/aperture`` is the horizontal sensor size; the standard ``aperture`` is the
f-number. EXIF writes 0 for what it does not know, which counts as missing here.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from lensfit.errors import ImageError
from lensfit.io.camera.aliases import ALIASES, Alias
from lensfit.io.camera.quantity import TEXTS
from lensfit.units import MILLIMETRES_PER_INCH

_DIAGONAL_35MM_MM = math.hypot(36.0, 24.0)
_EXIF_UNIT_MM: dict[object, float] = {
    2: MILLIMETRES_PER_INCH,
    3: 10.0,
    4: 1.0,
    5: 0.001,
}
_EXIF_INFINITY = 2**32 - 1
_EXIF_TURNED = (5, 6, 7, 8)


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


_MAY_BE_ZERO = ("overscan_percent",)
_MAY_BE_INFINITE = ("focus_distance_mm",)


def camera_state_from(
    header: Mapping[str, object],
    size_px: tuple[int, int] | None = None,
    aliases: Mapping[str, Sequence[Alias]] | None = None,
    known_better: Collection[str] = (),
) -> CameraState:
    """The camera state that a header describes.

    Parameters
    ----------
    header : Entries by name, of an EXR file or EXIF.
    size_px : Width and height of the upright picture, pixels; needed to turn EXIF's
        resolution on the sensor, or its 35 mm equivalent, into a sensor size.
    aliases : More entries, by field; they count before the built-in ones.
    known_better : Fields that somebody else tells: an impossible entry of theirs is
        passed over.

    Raises
    ------
    ImageError : An entry that is understood holds something impossible, like a focal
        length that is no number or not above zero; the error names it.
    """
    values: dict[str, float | str] = {}
    sources: dict[str, str] = {}
    for name, own in ALIASES.items():
        try:
            found = _first_known(header, name, (*(aliases or {}).get(name, ()), *own))
        except ImageError:
            if name not in known_better:
                raise
            found = None
        if found is not None:
            values[name], sources[name] = found
    try:
        values, sources = _with_sensor(header, values, sources, size_px, aliases or {})
    except ImageError:
        if "sensor_width_mm" not in known_better:
            raise
    return CameraState(**values, sources=sources)  # pyright: ignore[reportArgumentType]


def _first_known(
    header: Mapping[str, object], name: str, aliases: Sequence[Alias]
) -> tuple[float | str, str] | None:
    for alias in aliases:
        for key, value in header.items():
            if not _names(key, alias.key):
                continue
            text = name in TEXTS
            known = _text(value) if text else _number(name, key, value, alias)
            if known is not None:
                return known, key
    return None


def _names(key: str, alias: str) -> bool:
    if key == alias:
        return True
    prefix = key.removesuffix(f"/{alias}")
    if prefix == key:
        return False
    return "/" in alias or prefix.split("/")[-1] == "exr"


def _text(value: object) -> str | None:
    return str(value).split("\0")[0].strip() or None


def _number(name: str, key: str, value: object, alias: Alias) -> float | None:
    number = _float(key, value)
    if _is_exif(alias.key):
        if number == _EXIF_INFINITY:
            number = math.inf
        elif math.isnan(number) or number == 0:
            return None
    too_small = number < 0 or (number == 0 and name not in _MAY_BE_ZERO)
    if math.isnan(number) or too_small:
        raise _impossible(key, value, "a number above zero")
    if math.isinf(number) and name not in _MAY_BE_INFINITE:
        raise _impossible(key, value, "a finite number")
    # Single-precision headers: 1.4 is stored as 1.39999998.
    return float(f"{number * alias.factor:.7g}")


def _is_exif(key: str) -> bool:
    return key[0].isupper()


def _float(key: str, value: object) -> float:
    try:
        return float(value)  # pyright: ignore[reportArgumentType]
    except ZeroDivisionError:
        return math.nan
    except (TypeError, ValueError):
        raise _impossible(key, value, "a number") from None


def _impossible(key: str, value: object, expected: str) -> ImageError:
    shown = " ".join(str(value).split())[:40]
    return ImageError(
        f"header entry {key!r} is {shown!r} and should be {expected}",
        remedy="mend it, or state the value yourself",
    )


def _with_sensor(
    header: Mapping[str, object],
    values: dict[str, float | str],
    sources: dict[str, str],
    size_px: tuple[int, int] | None,
    aliases: Mapping[str, Sequence[Alias]],
) -> tuple[dict[str, float | str], dict[str, str]]:
    """Fill in the sensor size from the best entries that give both its sides."""
    named = {alias.key for alias in aliases.get("sensor_width_mm", ())}
    if any(_names(sources.get("sensor_width_mm", ""), key) for key in named):
        return values, sources
    candidates = (
        _from_photosites(header),
        _from_overall_dimensions(header),
        _from_focal_plane_resolution(header, size_px),
        _from_35mm_equivalent(header, values.get("focal_length_mm"), size_px),
    )
    for candidate in candidates:
        if candidate is None:
            continue
        (width, height), source = candidate
        exif = _is_exif(source)
        if exif and "sensor_width_mm" in values:
            break
        sides = {"sensor_width_mm": width, "sensor_height_mm": height}
        sources_of_sides = dict.fromkeys(sides, source)
        return values | sides, sources | sources_of_sides
    return values, sources


_Size = tuple[tuple[float, float], str] | None


def _from_photosites(header: Mapping[str, object]) -> _Size:
    keys = ("sensorPhotositePitch", "sensorAcquisitionRectangle")
    if not set(keys) <= header.keys():
        return None
    pitch_mm = _float(keys[0], header[keys[0]]) / 1000
    try:
        (x_min, y_min), (x_max, y_max) = header[keys[1]]  # pyright: ignore
        size = (int(x_max) - int(x_min) + 1, int(y_max) - int(y_min) + 1)
    except (TypeError, ValueError):
        raise _impossible(keys[1], header[keys[1]], "a box of photosites") from None
    return _positive(" x ".join(keys), (pitch_mm * size[0], pitch_mm * size[1]))


def _from_overall_dimensions(header: Mapping[str, object]) -> _Size:
    key = "sensorOverallDimensions"
    if key not in header:
        return None
    try:
        width, height = np.asarray(header[key], float)
    except (TypeError, ValueError):
        raise _impossible(key, header[key], "a width and a height") from None
    return _positive(key, (float(width), float(height)))


def _from_focal_plane_resolution(
    header: Mapping[str, object], size_px: tuple[int, int] | None
) -> _Size:
    """EXIF: pixels per unit on the sensor, for the picture as the camera stored it."""
    keys = ("FocalPlaneXResolution", "FocalPlaneYResolution")
    if size_px is None or not set(keys) <= header.keys():
        return None
    unit_mm = _EXIF_UNIT_MM.get(header.get("FocalPlaneResolutionUnit", 2), 25.4)
    pixels_per_mm = [_float(key, header[key]) / unit_mm for key in keys]
    if not all(0 < p < math.inf for p in pixels_per_mm):
        return None
    turned = header.get("Orientation") in _EXIF_TURNED
    now = size_px[::-1] if turned else size_px
    then = ("ExifImageWidth", "ExifImageHeight")
    stored = [_float(k, header.get(k, n)) or n for k, n in zip(then, now, strict=True)]
    sides = [n / p for n, p in zip(stored, pixels_per_mm, strict=True)]
    if turned:
        sides.reverse()
    return (float(f"{sides[0]:.6g}"), float(f"{sides[1]:.6g}")), " ".join(keys)


def _from_35mm_equivalent(
    header: Mapping[str, object],
    focal_length_mm: float | str | None,
    size_px: tuple[int, int] | None,
) -> _Size:
    """EXIF: the equivalent compares diagonals (CIPA DCG-001); whole millimetres."""
    key = "FocalLengthIn35mmFilm"
    if size_px is None or not isinstance(focal_length_mm, float) or key not in header:
        return None
    equivalent_mm = _float(key, header[key])
    if not 0 < equivalent_mm < math.inf:
        return None
    diagonal_mm = _DIAGONAL_35MM_MM * focal_length_mm / equivalent_mm
    scale = diagonal_mm / math.hypot(*size_px)
    width, height = (float(f"{scale * side:.4g}") for side in size_px)
    return (width, height), key


def _positive(key: str, size: tuple[float, float]) -> _Size:
    if not all(0 < side < math.inf for side in size):
        raise _impossible(key, size, "two lengths above zero")
    return (float(f"{size[0]:.7g}"), float(f"{size[1]:.7g}")), key

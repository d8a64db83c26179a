"""Samples of OpenTrackIO as a sidecar: one object, a list of them, or one in each line.

Each sample states the lens at a time: ``lens.pinholeFocalLength`` in mm, ``fStop``,
``tStop``, ``focusDistance`` in metres; ``static.camera`` the sensor's dimensions in mm.
Samples belong to frames by ``timing.timecode``. What is static holds until a later
sample states it anew, as it may be sent now and then only. A nominal focal length is
that of the lens' ring; the pinhole's grows with focusing
(`lensfit.plate.camera.plate_state`).

Source: camdkit's schema (SMPTE RIS), OpenTrackIO 1.0.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import Reading
from lensfit.io.camera.table import CameraTable, Row, RowReadings, shared
from lensfit.io.camera.text import MOST_ROWS, read_text
from lensfit.units import MILLIMETRES_PER_METRE

KIND = "OpenTrackIO stream"
CUSTOM_MARK = "custom: lensfit layout 1"
"""Line of a sample's calibration history where lensfit wrote its ``custom``: a preset
goes by the focal length on the zoom ring, for which there is no entry that may change.
"""
CUSTOM_LAYOUT = 1.0
"""First number of the sample's ``custom``; the nominal focal length in mm follows."""
_NUMBERS = (
    (("static", "lens", "nominalFocalLength"), "focal_length_mm", 1.0),
    (("lens", "pinholeFocalLength"), "pinhole_focal_length_mm", 1.0),
    (("lens", "fStop"), "f_number", 1.0),
    (("lens", "tStop"), "t_number", 1.0),
    (("lens", "focusDistance"), "focus_distance_mm", MILLIMETRES_PER_METRE),
    (
        ("static", "camera", "activeSensorPhysicalDimensions", "width"),
        "sensor_width_mm",
        1.0,
    ),
    (
        ("static", "camera", "activeSensorPhysicalDimensions", "height"),
        "sensor_height_mm",
        1.0,
    ),
)
_WORDS = (
    (("static", "lens", "model"), "lens_model"),
    (("static", "lens", "serialNumber"), "lens_serial"),
    (("static", "camera", "model"), "camera_model"),
)


def read_opentrackio_stream(path: str | Path) -> CameraTable:
    """A row for each sample.

    Raises
    ------
    CameraError : It is no JSON, no sample tells anything of the camera, or one holds
        what cannot be.
    """
    path = Path(path)
    rows, static = [], {}
    for number, sample in enumerate(_samples(path), 1):
        if number > MOST_ROWS:
            raise CameraError(f"has more than {MOST_ROWS} samples", where=path)
        found = _readings(path, number, sample)
        static |= {k: v for k, v in found.items() if v.entry.startswith("static")}
        rows.append(Row(number, static | found, _timecode(sample)))
    if not any(row.readings for row in rows):
        raise CameraError(
            "is JSON without a lens",
            where=path,
            remedy="give samples of OpenTrackIO, with lens.pinholeFocalLength",
        )
    return CameraTable(path, KIND, shared(rows))


def _samples(path: Path) -> Iterator[Mapping[str, Any]]:
    text = read_text(path)
    try:
        try:
            found = json.loads(text)
        except ValueError:
            found = [json.loads(line) for line in text.splitlines() if line.strip()]
    except (ValueError, RecursionError) as error:
        raise CameraError(f"is not valid JSON ({error})", where=path) from error
    for sample in found if isinstance(found, list) else [found]:
        if not isinstance(sample, dict):
            raise CameraError("holds a sample that is no object", where=path)
        yield sample


def _readings(path: Path, number: int, sample: Mapping[str, Any]) -> dict[str, Reading]:
    found = RowReadings(path, number)
    for keys, name, scale in _NUMBERS:
        value = _part(sample, keys)
        if value is None:
            continue
        entry = ".".join(keys)
        plain = found.number(str(value), entry)
        found.put(name, None if plain is None else plain * scale, entry)
    nominal = _nominal_mm(sample)
    if nominal is not None:
        found.put("focal_length_mm", nominal, "lens.custom")
    for keys, name in _WORDS:
        value = _part(sample, keys)
        if isinstance(value, str) and value.strip():
            found.put(name, value, ".".join(keys))
    return dict(found)


def _nominal_mm(sample: Mapping[str, Any]) -> float | None:
    """Focal length on the ring, where lensfit wrote the sample."""
    history = _part(sample, ("static", "lens", "calibrationHistory"))
    custom = _part(sample, ("lens", "custom"))
    if not isinstance(history, list) or CUSTOM_MARK not in history:
        return None
    if not isinstance(custom, list) or len(custom) < 2 or custom[0] != CUSTOM_LAYOUT:
        return None
    nominal = custom[1]
    return float(nominal) if isinstance(nominal, int | float) else None


def _part(sample: Mapping[str, Any], keys: tuple[str, ...]) -> Any:
    found: Any = sample
    for key in keys:
        found = found.get(key) if isinstance(found, dict) else None
    return found


def _timecode(sample: Mapping[str, Any]) -> str | None:
    parts = [
        _part(sample, ("timing", "timecode", key))
        for key in ("hours", "minutes", "seconds", "frames")
    ]
    if not all(isinstance(part, int) and 0 <= part < 1000 for part in parts):
        return None
    return ":".join(f"{part:02d}" for part in parts)

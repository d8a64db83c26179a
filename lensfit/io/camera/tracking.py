"""Tracking data with the lens of each frame: samples of OpenTrackIO, Mo-Sys' F4.

A sample of OpenTrackIO states the lens at a time: ``lens.pinholeFocalLength`` in mm,
``fStop``, ``tStop``, ``focusDistance`` in metres; ``static.camera`` the sensor's
dimensions in mm. Samples belong to frames by ``timing.timecode``. What is static holds
until a later sample states it anew, as it may be sent now and then only. A nominal
focal length is that of the lens' ring; the pinhole's grows with focusing
(`lensfit.plate.camera.plate_state`).

Source: camdkit's schema (SMPTE RIS), OpenTrackIO 1.0.

A packet of Mo-Sys is the byte F4, the camera's number, the count of its blocks, a
status, blocks of five bytes (a field, and four bytes of it), and a checksum: 40
hexadecimal less the sum of all before. Read are the timecode (field F8), one over the
focus distance in metres (57) and the f-number (60), both single-precision numbers,
first byte highest.

The focal length is left out: its fields (53, 58) are published as angles of view, and
recordings hold some 1500 in them, which are pixels.

Source: Mo-Sys' reader in camdkit (SMPTE RIS), camdkit/mosys/f4.py, with its recording.
"""

import json
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from lensfit.bounded import read_bounded
from lensfit.errors import CameraError
from lensfit.io.camera.quantity import Reading, error_at_line
from lensfit.io.camera.table import (
    MOST_BYTES,
    MOST_ROWS,
    CameraTable,
    Row,
    RowReadings,
    read_text,
    rows_with_shared_readings,
)
from lensfit.units import MILLIMETRES_PER_METRE

OPENTRACKIO_KIND = "OpenTrackIO stream"
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
        rows.append(Row(number, static | found, _sample_timecode(sample)))
    if not any(row.readings for row in rows):
        raise CameraError(
            "is JSON without a lens",
            where=path,
            remedy="give samples of OpenTrackIO, with lens.pinholeFocalLength",
        )
    return CameraTable(path, OPENTRACKIO_KIND, rows_with_shared_readings(rows))


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


def _sample_timecode(sample: Mapping[str, Any]) -> str | None:
    parts = [
        _part(sample, ("timing", "timecode", key))
        for key in ("hours", "minutes", "seconds", "frames")
    ]
    if not all(isinstance(part, int) and 0 <= part < 1000 for part in parts):
        return None
    return ":".join(f"{part:02d}" for part in parts)


MOSYS_KIND = "Mo-Sys F4 recording"
COMMAND = 0xF4
_TIMECODE, _INVERSE_FOCUS, _F_NUMBER = 0xF8, 0x57, 0x60
_HEAD, _BLOCK = 4, 5
_CHECKSUM = 0x40
_REMEDY = "record it again, or export OpenTrackIO samples"


class _Packet(NamedTuple):
    """Its place in the file, and its blocks by field."""

    start: int
    blocks: dict[int, bytes]


def is_mosys_f4(beginning: bytes) -> bool:
    """Whether a file begins with a whole packet."""
    return bool(beginning) and beginning[0] == COMMAND and _size(beginning, 0) > 0


def read_mosys_f4(path: str | Path) -> CameraTable:
    """A row for each packet, by timecode.

    Raises
    ------
    CameraError : It cannot be read, is no such recording or damaged, or no packet
        states a focus distance or an f-number.
    """
    path = Path(path)
    data = read_bounded(
        path, MOST_BYTES, error=CameraError, too_large="cut it to the shot"
    )
    rows = []
    for number, packet in enumerate(_packets(data, path), 1):
        if number > MOST_ROWS:
            raise CameraError(f"has more than {MOST_ROWS} packets", where=path)
        rows.append(_row(path, number, packet))
    if not any(row.readings for row in rows):
        raise CameraError(
            f"is a {MOSYS_KIND} without a focus distance or an f-number",
            where=path,
            remedy="map the lens in the tracker, so that it sends them",
        )
    note = (
        f"{path.name} is a {MOSYS_KIND}: it tells the focus distance and the f-number; "
        "the focal length comes from another source (--focal-length-mm)"
    )
    return CameraTable(path, MOSYS_KIND, rows_with_shared_readings(rows), (note,))


def _packets(data: bytes, path: Path) -> Iterator[_Packet]:
    """All whole ones; what a recording that was cut off has of its last is left out."""
    start = 0
    while start < len(data):
        size = _size(data, start)
        if data[start] != COMMAND or (size == 0 and start == 0):
            raise CameraError(
                f"is no {MOSYS_KIND}, or damaged at byte {start}",
                where=path,
                remedy=_REMEDY,
            )
        if size == 0:
            return
        last = start + size - 1
        if (_CHECKSUM - sum(data[start:last])) % 256 != data[last]:
            raise CameraError(
                f"is damaged: the checksum of the packet at byte {start} is wrong",
                where=path,
                remedy=_REMEDY,
            )
        firsts = range(start + _HEAD, last, _BLOCK)
        yield _Packet(start, {data[i]: data[i + 1 : i + _BLOCK] for i in firsts})
        start += size


def _size(data: bytes, start: int) -> int:
    """Bytes of the packet there; 0 if it is not there as a whole."""
    if len(data) < start + _HEAD or data[start + 2] == 0:
        return 0
    size = _HEAD + _BLOCK * data[start + 2] + 1
    return size if start + size <= len(data) else 0


def _row(path: Path, number: int, packet: _Packet) -> Row:
    found = RowReadings(path, number)
    inverse = _number(packet, _INVERSE_FOCUS, path)
    if inverse:
        found.put("focus_distance_mm", MILLIMETRES_PER_METRE / inverse, "field 57")
    found.put("f_number", _number(packet, _F_NUMBER, path), "field 60")
    timecode = packet.blocks.get(_TIMECODE)
    return Row(number, found, None if timecode is None else _packet_timecode(timecode))


def _number(packet: _Packet, field: int, path: Path) -> float | None:
    block = packet.blocks.get(field)
    if block is None:
        return None
    value = struct.unpack(">f", block)[0]
    if value != value or value < 0:
        error = CameraError(f"field {field:02X} is {value:g}", remedy=_REMEDY)
        raise error_at_line(error, path, f"packet at byte {packet.start}")
    return value


def _packet_timecode(block: bytes) -> str:
    """Six bits each of hours, minutes, seconds and frames, behind a byte of status."""
    bits = int.from_bytes(block[1:], "big")
    parts = ((bits >> shift) & 0x3F for shift in (18, 12, 6, 0))
    return ":".join(f"{part:02d}" for part in parts)

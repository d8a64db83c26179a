"""A recording of Mo-Sys' tracking protocol F4: a packet for each frame.

A packet is the byte F4, the camera's number, the count of its blocks, a status, blocks
of five bytes (a field, and four bytes of it), and a checksum: 40 hexadecimal less the
sum of all before. Read are the timecode (field F8), one over the focus distance in
metres (57) and the f-number (60), both single-precision numbers, first byte highest.

The focal length is left out: its fields (53, 58) are published as angles of view, and
recordings hold some 1500 in them, which are pixels.

Source: Mo-Sys' reader in camdkit (SMPTE RIS), camdkit/mosys/f4.py, with its recording.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from lensfit.bounded import read_bounded
from lensfit.errors import CameraError
from lensfit.io.camera.quantity import error_at_line
from lensfit.io.camera.table import CameraTable, Row, RowReadings, shared
from lensfit.io.camera.text import MOST_BYTES, MOST_ROWS
from lensfit.units import MILLIMETRES_PER_METRE

KIND = "Mo-Sys F4 recording"
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
            f"is a {KIND} without a focus distance or an f-number",
            where=path,
            remedy="map the lens in the tracker, so that it sends them",
        )
    note = (
        f"{path.name} is a {KIND}: it tells the focus distance and the f-number; the "
        "focal length comes from another source (--focal-length-mm)"
    )
    return CameraTable(path, KIND, shared(rows), (note,))


def _packets(data: bytes, path: Path) -> Iterator[_Packet]:
    """All whole ones; what a recording that was cut off has of its last is left out."""
    start = 0
    while start < len(data):
        size = _size(data, start)
        if data[start] != COMMAND or (size == 0 and start == 0):
            raise CameraError(
                f"is no {KIND}, or damaged at byte {start}", where=path, remedy=_REMEDY
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
    return Row(number, found, None if timecode is None else _timecode(timecode))


def _number(packet: _Packet, field: int, path: Path) -> float | None:
    block = packet.blocks.get(field)
    if block is None:
        return None
    value = struct.unpack(">f", block)[0]
    if value != value or value < 0:
        error = CameraError(f"field {field:02X} is {value:g}", remedy=_REMEDY)
        raise error_at_line(error, path, f"packet at byte {packet.start}")
    return value


def _timecode(block: bytes) -> str:
    """Six bits each of hours, minutes, seconds and frames, behind a byte of status."""
    bits = int.from_bytes(block[1:], "big")
    parts = ((bits >> shift) & 0x3F for shift in (18, 12, 6, 0))
    return ":".join(f"{part:02d}" for part in parts)

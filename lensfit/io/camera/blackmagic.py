"""Blackmagic's text of a clip (ExtractMetadata of the RAW SDK), a block per frame.

A block begins with ``Clip Metadata`` or ``Frame 0 Metadata`` and holds lines such as
``distance: 991mm``. It has no timecode: its frames are counted.
"""

import re
from pathlib import Path

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import error_at_line, is_missing, number, stop, unit_mm
from lensfit.io.camera.table import CameraTable, Row, RowReadings, shared
from lensfit.io.camera.text import MOST_ROWS, read_lines

KIND = "Blackmagic text"
FRAME_HEADING = re.compile(r"Frame (\d{1,9}) Metadata\s*")
_LENGTH = re.compile(r"([-+]?[\d.]+|inf|infinity|Infinity)\s*([a-zA-Z]*)")


def read_blackmagic(path: str | Path) -> CameraTable:
    """The camera of each frame of a Blackmagic clip.

    Raises
    ------
    CameraError : The file is no such text, or a line holds what it may not.
    """
    path = Path(path)
    rows: list[Row] = []
    clip: dict[str, str] = {}
    block: RowReadings | None = None
    for line, text in read_lines(path):
        if FRAME_HEADING.fullmatch(text):
            block = RowReadings(path, line)
            block.put("lens_model", clip.get("lens_type"), "lens_type")
            block.put("camera_model", clip.get("camera_type"), "camera_type")
            rows.append(Row(line, block))
            if len(rows) > MOST_ROWS:
                raise CameraError(f"has more than {MOST_ROWS} frames", where=path)
            continue
        key, colon, value = text.partition(":")
        value = value.strip()
        if not colon or is_missing(value):
            continue
        if block is None:
            if key in ("lens_type", "camera_type"):
                clip[key] = value
            continue
        block.line = line
        try:
            _take(block, key, value)
        except CameraError as error:
            if error.where is not None:
                raise
            raise error_at_line(error, path, line) from None
    return CameraTable(path, KIND, shared(rows))


def _take(block: RowReadings, key: str, value: str) -> None:
    if key == "aperture":
        kind, stopped = stop(value, key)
        block.put("t_number" if kind == "T" else "f_number", stopped, key)
    elif key == "focal_length":
        block.put("focal_length_mm", _length_mm(value, key), key)
    elif key == "distance":
        block.put("focus_distance_mm", _length_mm(value, key), key)


def _length_mm(text: str, key: str) -> float:
    """A length with its unit; millimetres if it has none."""
    match = _LENGTH.fullmatch(text) if len(text) < 64 else None
    if match is None:
        raise CameraError(f"{key} is {text[:40]!r} and should be a length, as 991mm")
    return number(match[1], key) * (unit_mm(match[2], key) if match[2] else 1.0)

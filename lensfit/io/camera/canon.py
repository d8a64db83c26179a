"""Canon's table of frames: fractions, and focus as the bits of a float.

``FocusPosition`` holds the eight hexadecimal digits of a single-precision number, which
is taken as metres; the file does not say so, and a note does. ``ApertureMode`` 2 counts
T-stops, 1 f-numbers. All bits set (FFFFFFFF, 65535/65535) is not known.
"""

import math
import re
import struct
from pathlib import Path

from lensfit.errors import CameraError
from lensfit.io.camera.table import (
    CameraTable,
    Row,
    RowReadings,
    plain_timecode,
    shared,
)
from lensfit.io.camera.text import Sheet, read_sheet
from lensfit.units import MILLIMETRES_PER_METRE

KIND = "Canon table of frames"
_FOCUS = "FocusPosition"
_UNKNOWN = ("65535/65535", "4294967295/4294967295")
_HEX = re.compile(r"(?:0[xX])?([0-9a-fA-F]{8})")


def read_canon(path: str | Path) -> CameraTable:
    """The camera of each frame of a Canon clip.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    sheet = read_sheet(path, ",")
    if not {_FOCUS, "ApertureNumber"} <= sheet.columns.keys():
        raise CameraError(f"is no {KIND}: it has no column {_FOCUS}", where=path)
    rows = shared(_row(path, sheet, line, cells) for line, cells in sheet.rows)
    note = f"{_FOCUS} of {path.name} is taken as metres, which the file does not say"
    knows = any("focus_distance_mm" in row.readings for row in rows)
    return CameraTable(path, KIND, rows, (note,) if knows else ())


def _row(path: Path, sheet: Sheet, line: int, cells: list[str]) -> Row:
    found = RowReadings(path, line)

    def fraction(column: str) -> float | None:
        text = sheet.cell(cells, column)
        return None if text in _UNKNOWN else found.number(text, column)

    found.put("focal_length_mm", fraction("FocalLength"), "FocalLength")
    mode = sheet.cell(cells, "ApertureMode")
    if mode in ("1", "2"):
        name = "t_number" if mode == "2" else "f_number"
        found.put(name, fraction("ApertureNumber"), "ApertureNumber")
    focus = sheet.cell(cells, _FOCUS)
    if focus is not None:
        metres = _single(focus)
        if metres is None:
            raise CameraError(
                f"line {line}: {_FOCUS} is {focus[:40]!r} and should be a number as "
                "eight hexadecimal digits",
                where=path,
            )
        if not math.isnan(metres):
            found.put("focus_distance_mm", metres * MILLIMETRES_PER_METRE, _FOCUS)
    return Row(line, found, plain_timecode(sheet.cell(cells, "Timecode")))


def _single(text: str) -> float | None:
    match = _HEX.fullmatch(text)
    return None if match is None else struct.unpack(">f", bytes.fromhex(match[1]))[0]

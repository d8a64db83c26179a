"""What cameras leave beside a clip: tables of ARRI, Canon, RED, Sony; texts of others.

ARRI (Meta Extract; called .csv) is tab-separated, marks what is missing with ``--`` or
``n.a.``, and has the column ``Master TC`` twice. The stop comes from ``Lens Linear
Iris`` (finer) or ``Lens Iris``; both are T-stops. Recorded widths of the ALEXA LF:
8.25 um photosites, 3840 of them for 16:9 and 4448 for open gate (ARRI, formats and
resolutions overview).

Canon writes fractions, and focus as the bits of a float: ``FocusPosition`` holds the
eight hexadecimal digits of a single-precision number, which is taken as metres; the
file does not say so, and a note does. ``ApertureMode`` 2 counts T-stops, 1 f-numbers.
All bits set (FFFFFFFF, 65535/65535) is not known.

RED (REDline --printMeta 3 and 5) has a static table too. Focus distances are
millimetres: the static table writes the same number with its unit. It knows the sensor
and its photosites; what it says of focal length, stop and focus is the first frame's,
and is left to the table of frames. The stop of a lens that speaks Cooke /i is a T-stop
(its ``Cooke Metadata`` hold the same number).

Sony VENICE writes feet, and stops as "T 2 3/10". Source: the table of a clip in camdkit
(SMPTE RIS).

Blackmagic's (ExtractMetadata of the RAW SDK) has a block per frame. A block begins with
``Clip Metadata`` or ``Frame 0 Metadata`` and holds lines such as ``distance: 991mm``.
It has no timecode: its frames are counted.

Sony's (NonRealTimeMeta, called ...M01.XML) has what stays over the clip: the models of
camera and lens. Focal length, stop and focus are not in it, since they change. Source:
a clip of VENICE in camdkit (SMPTE RIS).
"""

import math
import re
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import (
    LENGTHS_MM,
    is_missing,
    number,
    stop,
    stop_of_linear_iris,
    unit_mm,
)
from lensfit.io.camera.table import (
    MOST_ROWS,
    CameraTable,
    Row,
    RowReadings,
    Sheet,
    plain_timecode,
    read_lines,
    read_sheet,
    read_text,
    rows_with_shared_readings,
)
from lensfit.units import MILLIMETRES_PER_METRE


class _Cells(RowReadings):
    """Readings of one row of a sheet, taken from its columns by their names."""

    def __init__(self, path: Path, line: int, sheet: Sheet, cells: list[str]):
        super().__init__(path, line)
        self._sheet, self._cells = sheet, cells

    def cell(self, column: str) -> str | None:
        return self._sheet.cell(self._cells, column)

    def number_in(self, column: str) -> float | None:
        return self.number(self.cell(column), column)

    def put_number(self, name: str, column: str) -> None:
        self.put(name, self.number_in(column), column)

    def put_texts(self, **columns: str) -> None:
        """Quantities that are text, each with its column."""
        for name, column in columns.items():
            self.put(name, self.cell(column), column)

    def row(self, timecode: str | None = None) -> Row:
        """The row, with the timecode that stands in a column."""
        at = None if timecode is None else plain_timecode(self.cell(timecode))
        return Row(self.line, self, at)


def _rows(
    path: Path,
    delimiter: str,
    kind: str,
    columns: set[str],
    lacked: str,
    needed: Callable[[Iterable[bool]], bool] = all,
) -> Iterator[_Cells]:
    """The rows of a table.

    Parameters
    ----------
    columns : Those by which it is known.
    lacked : The one that is named where they are missing.
    needed : Whether `all` of them are needed, or `any`.
    """
    sheet = read_sheet(path, delimiter)
    if not needed(column in sheet.columns for column in columns):
        raise CameraError(f"is no {kind}: it has no column {lacked}", where=path)
    for line, cells in sheet.rows:
        yield _Cells(path, line, sheet, cells)


ARRI_KIND = "ARRI table"
_ARRI_WIDTHS_MM = {
    ("ALEXALF", "1920"): 31.68,
    ("ALEXALF", "2048"): 31.68,
    ("ALEXALF", "3840"): 31.68,
    ("ALEXALF", "4448"): 36.696,
}
_ARRI_FOCUS = "Lens Focus Distance"
_ARRI_UNIT = "Lens Distance Unit"
_ARRI_LINEAR = "Lens Linear Iris"


def read_arri(path: str | Path) -> CameraTable:
    """The camera of each frame of an ARRI clip.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    columns = {_ARRI_FOCUS, "Lens Focal Length"}
    rows = _rows(path, "\t", ARRI_KIND, columns, repr(_ARRI_FOCUS), any)
    return CameraTable(path, ARRI_KIND, rows_with_shared_readings(map(_arri_row, rows)))


def _arri_row(found: _Cells) -> Row:
    found.put_number("focal_length_mm", "Lens Focal Length")
    distance = found.number_in(_ARRI_FOCUS)
    with found.naming_line():
        if distance:
            unit = unit_mm(found.cell(_ARRI_UNIT) or "", _ARRI_UNIT)
            found.put("focus_distance_mm", distance * unit, _ARRI_FOCUS)
        linear, iris = found.number_in(_ARRI_LINEAR), found.cell("Lens Iris")
        if linear:
            found.put("t_number", stop_of_linear_iris(linear), _ARRI_LINEAR)
        elif iris is not None:
            found.put("t_number", stop(iris, "Lens Iris")[1], "Lens Iris")
    family = found.cell("Camera Family") or ""
    width = found.cell("Image Width") or ""
    found.put(
        "sensor_width_mm",
        _ARRI_WIDTHS_MM.get((family.replace(" ", ""), width)),
        "Camera Family, Image Width",
    )
    found.put_texts(
        camera_model="Camera Model",
        lens_model="Lens Model",
        lens_serial="Lens Serial Number",
    )
    return found.row("Master TC")


CANON_KIND = "Canon table of frames"
_CANON_FOCUS = "FocusPosition"
_CANON_UNKNOWN = ("65535/65535", "4294967295/4294967295")
_HEX = re.compile(r"(?:0[xX])?([0-9a-fA-F]{8})")


def read_canon(path: str | Path) -> CameraTable:
    """The camera of each frame of a Canon clip.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    columns = {_CANON_FOCUS, "ApertureNumber"}
    found = _rows(path, ",", CANON_KIND, columns, _CANON_FOCUS)
    rows = rows_with_shared_readings(map(_canon_row, found))
    note = (
        f"{_CANON_FOCUS} of {path.name} is taken as metres, which the file does not say"
    )
    knows = any("focus_distance_mm" in row.readings for row in rows)
    return CameraTable(path, CANON_KIND, rows, (note,) if knows else ())


def _canon_row(found: _Cells) -> Row:
    def put_fraction(name: str, column: str) -> None:
        if found.cell(column) not in _CANON_UNKNOWN:
            found.put_number(name, column)

    put_fraction("focal_length_mm", "FocalLength")
    mode = found.cell("ApertureMode")
    if mode in ("1", "2"):
        put_fraction("t_number" if mode == "2" else "f_number", "ApertureNumber")
    focus = found.cell(_CANON_FOCUS)
    if focus is not None:
        metres = _single(focus)
        if metres is None:
            raise CameraError(
                f"line {found.line}: {_CANON_FOCUS} is {focus[:40]!r} and should be a "
                "number as eight hexadecimal digits",
                where=found.path,
            )
        if not math.isnan(metres):
            distance_mm = metres * MILLIMETRES_PER_METRE
            found.put("focus_distance_mm", distance_mm, _CANON_FOCUS)
    return found.row("Timecode")


def _single(text: str) -> float | None:
    match = _HEX.fullmatch(text)
    return None if match is None else struct.unpack(">f", bytes.fromhex(match[1]))[0]


RED_FRAMES_KIND = "RED table of frames"
RED_STATIC_KIND = "RED static table"
_RED_PITCH_UM = {
    "RAPTOR 8K VV": 5.0,
    "MONSTRO 8K VV": 5.0,
    "KOMODO 6K S35": 4.4,
    "HELIUM 8K S35": 3.65,
    "GEMINI 5K S35": 6.0,
}
"""Photosites; a frame smaller than the sensor is a window of it, not scaled."""


def read_red_frames(path: str | Path) -> CameraTable:
    """The camera of each frame of a RED clip.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    columns = {"FrameNo", "Focus Distance"}
    rows = _rows(path, ",", RED_FRAMES_KIND, columns, "FrameNo")
    return CameraTable(
        path, RED_FRAMES_KIND, rows_with_shared_readings(map(_red_frame, rows))
    )


def read_red_static(path: str | Path) -> CameraTable:
    """The camera and lens of a RED clip, which stay.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    found = _rows(path, ",", RED_STATIC_KIND, {"Camera PIN"}, "Camera PIN")
    rows = [_red_static(cells) for cells in found]
    note = (
        f"{path.name} is a {RED_STATIC_KIND}: it tells the sensor and the lens; focal "
        "length, stop and focus come from its table of frames (--metadata)"
    )
    return CameraTable(path, RED_STATIC_KIND, rows[:1], (note,))


def _red_frame(found: _Cells) -> Row:
    found.put_number("focal_length_mm", "Focal Length")
    found.put_number("focus_distance_mm", "Focus Distance")
    cooke = found.cell("Cooke Metadata") is not None
    found.put_number("t_number" if cooke else "f_number", "Aperture")
    return found.row("Timecode")


def _red_static(found: _Cells) -> Row:
    pitch_um = _RED_PITCH_UM.get((found.cell("Sensor Name") or "").upper())
    if pitch_um is not None:
        for name, column in (
            ("sensor_width_mm", "Frame Width"),
            ("sensor_height_mm", "Frame Height"),
        ):
            photosites = found.number_in(column)
            if photosites is not None:
                found.put(name, photosites * pitch_um / 1000, f"Sensor Name, {column}")
    found.put_texts(
        camera_model="Camera Model",
        lens_model="Lens Name",
        lens_serial="Lens Serial Number",
    )
    return found.row()


SONY_KIND = "Sony VENICE table"
_SONY_FOCAL = "Focal Length (mm)"
_SONY_FOCUS = "Focus Distance (ft)"


def read_sony(path: str | Path) -> CameraTable:
    """The camera of each frame of a Sony VENICE clip.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    columns = {_SONY_FOCAL, _SONY_FOCUS}
    rows = _rows(path, ",", SONY_KIND, columns, repr(_SONY_FOCUS), any)
    return CameraTable(path, SONY_KIND, rows_with_shared_readings(map(_sony_row, rows)))


def _sony_row(found: _Cells) -> Row:
    found.put_number("focal_length_mm", _SONY_FOCAL)
    feet = found.number_in(_SONY_FOCUS)
    if feet is not None:
        found.put("focus_distance_mm", feet * LENGTHS_MM["ft"], _SONY_FOCUS)
    aperture = found.cell("Aperture")
    if aperture is not None:
        with found.naming_line():
            kind, value = stop(aperture, "Aperture")
        found.put("f_number" if kind == "F" else "t_number", value, "Aperture")
    found.put_texts(
        camera_model="Camera Model", lens_model="Lens Model", lens_serial="Lens Serial"
    )
    return found.row("Timecode")


BLACKMAGIC_KIND = "Blackmagic text"
FRAME_HEADING = re.compile(r"Frame (\d{1,9}) Metadata\s*")
"""Of Blackmagic's blocks."""
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
        with block.naming_line():
            _take(block, key, value)
    return CameraTable(path, BLACKMAGIC_KIND, rows_with_shared_readings(rows))


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


SONY_XML_KIND = "Sony clip XML"
SONY_XML_ROOT = "NonRealTimeMeta"
_MOST_XML_BYTES = 4 << 20
_MODELS = (("Camera", "camera_model"), ("Lens", "lens_model"))
_ENTITIES = ("<!DOCTYPE", "<!ENTITY")


def read_sony_xml(path: str | Path) -> CameraTable:
    """The camera and lens of a Sony clip.

    Raises
    ------
    CameraError : It is no such XML, or states neither.
    """
    path = Path(path)
    text = read_text(path, _MOST_XML_BYTES)
    if any(word in text for word in _ENTITIES):
        raise CameraError("is XML with entities, which no camera writes", where=path)
    # The text is decoded: the encoding that its first line declares no longer counts.
    parser = ElementTree.XMLParser(encoding="utf-8")
    try:
        root = ElementTree.fromstring(text.encode(), parser)
    except ElementTree.ParseError as error:
        raise CameraError(f"is not valid XML ({error})", where=path) from error
    if _plain_name(root) != SONY_XML_ROOT:
        raise CameraError(
            f"is no {SONY_XML_KIND}: it holds no {SONY_XML_ROOT}", where=path
        )
    found = RowReadings(path, 1)
    for element in root.iter():
        for name, quantity in _MODELS:
            model = (element.get("modelName") or "").strip()
            if _plain_name(element) == name and model:
                found.put(quantity, model, f"{name} modelName")
    if not found:
        raise CameraError(
            f"is a {SONY_XML_KIND} without a camera or a lens", where=path
        )
    note = (
        f"{path.name} is a {SONY_XML_KIND}: it tells the camera and the lens; focal "
        "length, stop and focus come from the clip's table of frames (--metadata)"
    )
    return CameraTable(path, SONY_XML_KIND, [Row(1, found)], (note,))


def _plain_name(element: ElementTree.Element) -> str:
    """Without its namespace, which holds a version."""
    return element.tag.rpartition("}")[2]

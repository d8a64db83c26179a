"""Sony's two files of a clip: VENICE's table of frames, and the XML beside the clip.

The table has one row per frame: feet, and stops as "T 2 3/10". The XML
(NonRealTimeMeta, called ...M01.XML) has what stays over the clip: the models of camera
and lens. Focal length, stop and focus are not in it, since they change.

Source: a clip of VENICE in camdkit (SMPTE RIS), with the table that belongs to it.
"""

from pathlib import Path
from xml.etree import ElementTree

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import LENGTHS_MM, error_at_line, stop
from lensfit.io.camera.table import (
    CameraTable,
    Row,
    RowReadings,
    plain_timecode,
    shared,
)
from lensfit.io.camera.text import Sheet, read_sheet, read_text

TABLE_KIND = "Sony VENICE table"
XML_KIND = "Sony clip XML"
XML_ROOT = "NonRealTimeMeta"
_FOCAL = "Focal Length (mm)"
_FOCUS = "Focus Distance (ft)"
_MOST_BYTES = 4 << 20
_MODELS = (("Camera", "camera_model"), ("Lens", "lens_model"))
_ENTITIES = ("<!DOCTYPE", "<!ENTITY")


def read_sony(path: str | Path) -> CameraTable:
    """The camera of each frame of a Sony VENICE clip.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    sheet = read_sheet(path, ",")
    if not {_FOCAL, _FOCUS} & sheet.columns.keys():
        raise CameraError(
            f"is no {TABLE_KIND}: it has no column {_FOCUS!r}", where=path
        )
    rows = shared(_row(path, sheet, line, cells) for line, cells in sheet.rows)
    return CameraTable(path, TABLE_KIND, rows)


def read_sony_xml(path: str | Path) -> CameraTable:
    """The camera and lens of a Sony clip.

    Raises
    ------
    CameraError : It is no such XML, or states neither.
    """
    path = Path(path)
    text = read_text(path, _MOST_BYTES)
    if any(word in text for word in _ENTITIES):
        raise CameraError("is XML with entities, which no camera writes", where=path)
    # The text is decoded: the encoding that its first line declares no longer counts.
    parser = ElementTree.XMLParser(encoding="utf-8")
    try:
        root = ElementTree.fromstring(text.encode(), parser)
    except ElementTree.ParseError as error:
        raise CameraError(f"is not valid XML ({error})", where=path) from error
    if _plain_name(root) != XML_ROOT:
        raise CameraError(f"is no {XML_KIND}: it holds no {XML_ROOT}", where=path)
    found = RowReadings(path, 1)
    for element in root.iter():
        for name, quantity in _MODELS:
            model = (element.get("modelName") or "").strip()
            if _plain_name(element) == name and model:
                found.put(quantity, model, f"{name} modelName")
    if not found:
        raise CameraError(f"is a {XML_KIND} without a camera or a lens", where=path)
    note = (
        f"{path.name} is a {XML_KIND}: it tells the camera and the lens; focal length, "
        "stop and focus come from the clip's table of frames (--metadata)"
    )
    return CameraTable(path, XML_KIND, [Row(1, found)], (note,))


def _row(path: Path, sheet: Sheet, line: int, cells: list[str]) -> Row:
    found = RowReadings(path, line)
    found.put(
        "focal_length_mm", found.number(sheet.cell(cells, _FOCAL), _FOCAL), _FOCAL
    )
    feet = found.number(sheet.cell(cells, _FOCUS), _FOCUS)
    if feet is not None:
        found.put("focus_distance_mm", feet * LENGTHS_MM["ft"], _FOCUS)
    aperture = sheet.cell(cells, "Aperture")
    if aperture is not None:
        try:
            kind, value = stop(aperture, "Aperture")
        except CameraError as error:
            raise error_at_line(error, path, line) from None
        found.put("f_number" if kind == "F" else "t_number", value, "Aperture")
    found.put("camera_model", sheet.cell(cells, "Camera Model"), "Camera Model")
    found.put("lens_model", sheet.cell(cells, "Lens Model"), "Lens Model")
    found.put("lens_serial", sheet.cell(cells, "Lens Serial"), "Lens Serial")
    return Row(line, found, plain_timecode(sheet.cell(cells, "Timecode")))


def _plain_name(element: ElementTree.Element) -> str:
    """Without its namespace, which holds a version."""
    return element.tag.rpartition("}")[2]

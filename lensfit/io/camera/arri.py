"""ARRI's table of a clip, one row per frame (ARRI Meta Extract; called .csv).

It is tab-separated, marks what is missing with ``--`` or ``n.a.``, and has the column
``Master TC`` twice. The stop comes from ``Lens Linear Iris`` (finer) or ``Lens Iris``;
both are T-stops. Recorded widths of the ALEXA LF: 8.25 um photosites, 3840 of them for
16:9 and 4448 for open gate (ARRI, formats and resolutions overview).
"""

from pathlib import Path

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import error_at_line, stop, stop_of_linear_iris, unit_mm
from lensfit.io.camera.table import (
    CameraTable,
    Row,
    RowReadings,
    plain_timecode,
    shared,
)
from lensfit.io.camera.text import Sheet, read_sheet

KIND = "ARRI table"
_WIDTHS_MM = {
    ("ALEXALF", "1920"): 31.68,
    ("ALEXALF", "2048"): 31.68,
    ("ALEXALF", "3840"): 31.68,
    ("ALEXALF", "4448"): 36.696,
}
_FOCUS = "Lens Focus Distance"
_UNIT = "Lens Distance Unit"
_LINEAR = "Lens Linear Iris"


def read_arri(path: str | Path) -> CameraTable:
    """The camera of each frame of an ARRI clip.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    sheet = read_sheet(path, "\t")
    if not {_FOCUS, "Lens Focal Length"} & sheet.columns.keys():
        raise CameraError(f"is no {KIND}: it has no column {_FOCUS!r}", where=path)
    rows = shared(_row(path, sheet, line, cells) for line, cells in sheet.rows)
    return CameraTable(path, KIND, rows)


def _row(path: Path, sheet: Sheet, line: int, cells: list[str]) -> Row:
    found = RowReadings(path, line)

    def number(column: str) -> float | None:
        return found.number(sheet.cell(cells, column), column)

    found.put("focal_length_mm", number("Lens Focal Length"), "Lens Focal Length")
    distance = number(_FOCUS)
    try:
        if distance:
            unit = unit_mm(sheet.cell(cells, _UNIT) or "", _UNIT)
            found.put("focus_distance_mm", distance * unit, _FOCUS)
        linear, iris = number(_LINEAR), sheet.cell(cells, "Lens Iris")
        if linear:
            found.put("t_number", stop_of_linear_iris(linear), _LINEAR)
        elif iris is not None:
            found.put("t_number", stop(iris, "Lens Iris")[1], "Lens Iris")
    except CameraError as error:
        if error.where is not None:
            raise
        raise error_at_line(error, path, line) from None
    family = sheet.cell(cells, "Camera Family") or ""
    width = sheet.cell(cells, "Image Width") or ""
    found.put(
        "sensor_width_mm",
        _WIDTHS_MM.get((family.replace(" ", ""), width)),
        "Camera Family, Image Width",
    )
    found.put("camera_model", sheet.cell(cells, "Camera Model"), "Camera Model")
    found.put("lens_model", sheet.cell(cells, "Lens Model"), "Lens Model")
    found.put(
        "lens_serial", sheet.cell(cells, "Lens Serial Number"), "Lens Serial Number"
    )
    return Row(line, found, plain_timecode(sheet.cell(cells, "Master TC")))

"""Sony VENICE's table of a clip, one row per frame: feet, and stops as "T 2 3/10"."""

from pathlib import Path

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import LENGTHS_MM, error_at_line
from lensfit.io.camera.stop_text import stop
from lensfit.io.camera.table import (
    CameraTable,
    Row,
    RowReadings,
    plain_timecode,
    shared,
)
from lensfit.io.camera.text import Sheet, read_sheet

KIND = "Sony VENICE table"
_FOCAL = "Focal Length (mm)"
_FOCUS = "Focus Distance (ft)"


def read_sony(path: str | Path) -> CameraTable:
    """The camera of each frame of a Sony VENICE clip.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    sheet = read_sheet(path, ",")
    if not {_FOCAL, _FOCUS} & sheet.columns.keys():
        raise CameraError(f"is no {KIND}: it has no column {_FOCUS!r}", where=path)
    rows = shared(_row(path, sheet, line, cells) for line, cells in sheet.rows)
    return CameraTable(path, KIND, rows)


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

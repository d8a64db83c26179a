"""RED's two tables of a clip (REDline --printMeta 3 and 5): static, and per frame.

Focus distances are millimetres: the static table writes the same number with its unit.
The static table knows the sensor and its photosites; what it says of focal length, stop
and focus is the first frame's, and is left to the table of frames. The stop of a lens
that speaks Cooke /i is a T-stop (its ``Cooke Metadata`` hold the same number).
"""

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

FRAMES_KIND = "RED table of frames"
STATIC_KIND = "RED static table"
_PITCH_UM = {
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
    sheet = read_sheet(path, ",")
    if not {"FrameNo", "Focus Distance"} <= sheet.columns.keys():
        raise CameraError(f"is no {FRAMES_KIND}: it has no column FrameNo", where=path)
    rows = shared(_frame(path, sheet, line, cells) for line, cells in sheet.rows)
    return CameraTable(path, FRAMES_KIND, rows)


def read_red_static(path: str | Path) -> CameraTable:
    """The camera and lens of a RED clip, which stay.

    Raises
    ------
    CameraError : The file is no such table, or a cell holds what it may not.
    """
    path = Path(path)
    sheet = read_sheet(path, ",")
    if "Camera PIN" not in sheet.columns:
        raise CameraError(
            f"is no {STATIC_KIND}: it has no column Camera PIN", where=path
        )
    rows = [_static(path, sheet, line, cells) for line, cells in sheet.rows]
    note = (
        f"{path.name} is a {STATIC_KIND}: it tells the sensor and the lens; focal "
        "length, stop and focus come from its table of frames (--metadata)"
    )
    return CameraTable(path, STATIC_KIND, rows[:1], (note,))


def _frame(path: Path, sheet: Sheet, line: int, cells: list[str]) -> Row:
    found = RowReadings(path, line)

    def number(column: str) -> float | None:
        return found.number(sheet.cell(cells, column), column)

    found.put("focal_length_mm", number("Focal Length"), "Focal Length")
    found.put("focus_distance_mm", number("Focus Distance"), "Focus Distance")
    cooke = sheet.cell(cells, "Cooke Metadata") is not None
    found.put("t_number" if cooke else "f_number", number("Aperture"), "Aperture")
    return Row(line, found, plain_timecode(sheet.cell(cells, "Timecode")))


def _static(path: Path, sheet: Sheet, line: int, cells: list[str]) -> Row:
    found = RowReadings(path, line)
    pitch_um = _PITCH_UM.get((sheet.cell(cells, "Sensor Name") or "").upper())
    if pitch_um is not None:
        for name, column in (
            ("sensor_width_mm", "Frame Width"),
            ("sensor_height_mm", "Frame Height"),
        ):
            photosites = found.number(sheet.cell(cells, column), column)
            if photosites is not None:
                found.put(name, photosites * pitch_um / 1000, f"Sensor Name, {column}")
    found.put("camera_model", sheet.cell(cells, "Camera Model"), "Camera Model")
    found.put("lens_model", sheet.cell(cells, "Lens Name"), "Lens Name")
    found.put(
        "lens_serial", sheet.cell(cells, "Lens Serial Number"), "Lens Serial Number"
    )
    return Row(line, found)

"""Nuke's ``.chan``: frame tx ty tz rx ry rz vfov, one line per frame.

The last column is the vertical field of view in degrees. It becomes a focal length
with the sensor's height: half the height over the tangent of half the angle.
"""

from pathlib import Path

from lensfit.errors import CameraError
from lensfit.io.camera.table import CameraTable, Row, RowReadings
from lensfit.io.camera.text import MOST_ROWS, read_lines

KIND = ".chan camera"
_ENTRY = "vfov"
_COLUMNS = 8


def read_chan(path: str | Path) -> CameraTable:
    """The field of view at each frame.

    Raises
    ------
    CameraError : A line is no row of numbers, has no field of view, or repeats a frame.
    """
    path = Path(path)
    rows: dict[int, Row] = {}
    for line, text in read_lines(path):
        words = text.split(maxsplit=_COLUMNS + 8)
        if not words or words[0].startswith("#"):
            continue
        row = _row(path, line, words)
        assert row.number is not None
        if row.number in rows:
            raise CameraError(
                f"line {line}: frame {row.number} stands twice", where=path
            )
        rows[row.number] = row
        if len(rows) > MOST_ROWS:
            raise CameraError(f"has more than {MOST_ROWS} frames", where=path)
    return CameraTable(path, KIND, list(rows.values()))


def _row(path: Path, line: int, words: list[str]) -> Row:
    found = RowReadings(path, line)
    if len(words) < _COLUMNS:
        raise CameraError(
            f"line {line} has {len(words)} numbers and should have {_COLUMNS}, the "
            "last of them the vertical field of view",
            where=path,
            remedy="export a camera, not another object",
        )
    numbers = [found.number(word, f"column {at}") for at, word in enumerate(words, 1)]
    frame = numbers[0]
    if frame is None or abs(frame) > 1e9 or frame != round(frame):
        raise CameraError(f"line {line}: {words[0][:40]!r} is no frame", where=path)
    found.put("vertical_fov_deg", numbers[_COLUMNS - 1], _ENTRY)
    return Row(line, found, number=round(frame))

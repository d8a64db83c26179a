"""Camera reports: tables with a row for each exposure, by file name or by time.

Comma- or tab-separated, with a line of column names, or an Avid Log Exchange file (ALE:
sections "Heading", "Column" and "Data", tab-separated). Columns are known by the names
that assistants and logging programs give them, whatever their case. Cells are written
as people write them: ``50mm``, ``T2.8``, ``f/4``, ``4'11"``, ``1.5 m``.
"""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import final

from lensfit.bounded import read_bounded, utf8_text
from lensfit.errors import CameraError
from lensfit.io.camera.quantity import is_missing

ALE_HEADING = "heading"
"""First line of an Avid Log Exchange file, in lower case."""
_LARGEST_BYTES = 16 * 2**20
_COLUMNS: dict[str, tuple[str, ...]] = {
    "name": ("image", "file", "file name", "filename", "clip", "clip name", "name",
             "photo", "slate"),
    "time": ("time", "date time", "datetime", "shot at", "exposed at", "date"),
    "focal_length_mm": ("focal length", "focal length mm", "focal", "lens mm"),
    "f_number": ("f number", "f-number", "f-stop", "fstop", "f stop", "aperture",
                 "iris", "stop"),
    "t_number": ("t number", "t-number", "t-stop", "tstop", "t stop"),
    "focus_distance_mm": ("focus distance", "focus", "focus mark", "focus dist",
                          "focus distance mm"),
    "target_distance_mm": ("target distance", "chart distance", "distance",
                           "target distance mm"),
    "lens_model": ("lens", "lens model", "lens name", "lens type"),
    "lens_serial": ("serial", "lens serial", "lens serial number", "s/n"),
}  # fmt: skip
_TIMES = ("%Y:%m:%d %H:%M:%S", "%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%S",
          "%Y-%m-%d %H:%M", "%Y-%m-%dT%H:%M", "%d.%m.%Y %H:%M:%S",
          "%d.%m.%Y %H:%M")  # fmt: skip
_CLOSE_S = 120.0


@final
@dataclass(frozen=True)
class Slate:
    """One row of a report.

    Attributes
    ----------
    place : File and line, for messages.
    name : Of the photograph, without folder and ending; None if the row names none.
    time : Of the exposure.
    values : Text of each quantity that the row states.
    """

    place: str
    name: str | None
    time: datetime | None
    values: Mapping[str, str] = field(default_factory=dict)


def read_slates(path: str | Path) -> list[Slate]:
    """The rows of a report.

    Raises
    ------
    CameraError : It cannot be read, has no column of names or times, or none of
        quantities.
    """
    path = Path(path)
    remedy = "give a CSV, tab-separated or ALE camera report"
    content = read_bounded(path, _LARGEST_BYTES, error=CameraError, remedy=remedy)
    text = utf8_text(content, path, error=CameraError, remedy=remedy)
    lines = _rows(text)
    if len(lines) < 2:
        raise CameraError(
            "has no rows under its column names", where=path, remedy=remedy
        )
    (_, names), *rows = lines
    columns = places_of_columns(names)
    if not columns.keys() & {"name", "time"}:
        raise CameraError(
            "has no column of file names or times",
            where=path,
            remedy=f'name a column "file" or "time"; it has {", ".join(names[:12])}',
        )
    if not columns.keys() - {"name", "time"}:
        raise CameraError(
            "has no column of lens settings",
            where=path,
            remedy='name columns "focal length", "f-stop", "t-stop", "focus"',
        )
    return [_slate(path, line, cells, columns) for line, cells in rows]


def slate_of(
    slates: Iterable[Slate], image: Path, exposed_at: str | None
) -> Slate | None:
    """The row of a photograph: that of its name, else the nearest in time.

    Parameters
    ----------
    exposed_at : Date and time of its header.

    Raises
    ------
    CameraError : Two rows are of this name and differ.
    """
    slates = list(slates)
    stem = image.stem.lower()
    named = [s for s in slates if s.name is not None and s.name.lower() == stem]
    for other in named[1:]:
        if other.values != named[0].values:
            raise CameraError(
                f"{named[0].place} and {other.place} are both of it, and differ",
                where=image.name,
                remedy="remove the row that does not hold",
            )
    if named:
        return named[0]
    moment = time_of(exposed_at)
    timed = [(s, s.time) for s in slates if s.time is not None and s.name is None]
    if moment is None or not timed:
        return None
    nearest, at = min(timed, key=lambda one: abs((one[1] - moment).total_seconds()))
    return nearest if abs((at - moment).total_seconds()) <= _CLOSE_S else None


def time_of(text: str | None) -> datetime | None:
    """A date with its time, as EXIF or a report writes it; None of anything else."""
    word = (text or "").strip().split("+")[0].removesuffix("Z").split(".000")[0]
    for form in _TIMES:
        try:
            return datetime.strptime(word, form)
        except ValueError:
            continue
    return None


def _rows(text: str) -> list[tuple[int, list[str]]]:
    """Line number and cells of the column names and of every row."""
    lines = text.splitlines()
    if lines and lines[0].strip().lower() == ALE_HEADING:
        return ale_rows(lines)
    first = next((line for line in lines if line.strip()), "")
    delimiter = max("\t,;", key=first.count)
    # A double quote that opens no cell is the sign of inches.
    quoted = re.search(rf'(?:^|{delimiter})"', text, re.MULTILINE) is not None
    quoting = csv.QUOTE_MINIMAL if quoted else csv.QUOTE_NONE
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, quoting=quoting)
    return [
        (reader.line_num, [cell.strip() for cell in row])
        for row in reader
        if any(cell.strip() for cell in row)
    ]


def ale_rows(lines: Sequence[str]) -> list[tuple[int, list[str]]]:
    """Line number and cells of an ALE's column names and of every row."""
    rows: list[tuple[int, list[str]]] = []
    section = ""
    for number, line in enumerate(lines, 1):
        word = line.strip().lower()
        if word in ("heading", "column", "data"):
            section = word
        elif word and section in ("column", "data"):
            rows.append((number, [cell.strip() for cell in line.split("\t")]))
    return rows


def places_of_columns(names: Sequence[str]) -> dict[str, int]:
    """Place of each quantity's column, by the names that are known of it."""
    plain = [re.sub(r"[\s_()\[\]]+", " ", name.lower()).strip() for name in names]
    found: dict[str, int] = {}
    for quantity, known in _COLUMNS.items():
        for name in known:
            if name in plain:
                found[quantity] = plain.index(name)
                break
    return found


def _slate(
    path: Path, line: int, cells: Sequence[str], columns: Mapping[str, int]
) -> Slate:
    def cell(quantity: str) -> str | None:
        k = columns.get(quantity)
        text = cells[k] if k is not None and k < len(cells) else ""
        return None if is_missing(text) else text

    values = {q: cell(q) for q in columns if q not in ("name", "time")}
    name = cell("name")
    return Slate(
        place=f"{path.name} line {line}",
        name=None if name is None else Path(name.replace("\\", "/")).stem,
        time=time_of(cell("time")),
        values={q: text for q, text in values.items() if text is not None},
    )

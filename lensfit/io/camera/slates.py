"""Camera reports by exposure, and an Avid Log Exchange file, a row for each clip.

Comma- or tab-separated, with a line of column names, or an Avid Log Exchange file (ALE:
sections "Heading", "Column" and "Data", tab-separated). Columns are known by the names
that assistants and logging programs give them, whatever their case. Cells are written
as people write them: ``50mm``, ``T2.8``, ``f/4``, ``4'11"``, ``1.5 m``.

Cameras and loggers keep in an ALE what stays over a clip. A row belongs to the plates
whose name begins with its clip's (``Name``, ``Clip Name`` or ``Source File``, without
the ending), else to those with a timecode from ``Start`` to before ``End``. The columns
of the lens are those of camera reports; focus distances name their unit.
"""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import NamedTuple, final

from lensfit.bounded import read_bounded, utf8_text
from lensfit.errors import CameraError
from lensfit.io.camera.quantity import (
    is_missing,
    number,
    stop,
    written_length_mm,
)
from lensfit.io.camera.table import (
    MOST_ROWS,
    CameraFile,
    FrameKey,
    Readings,
    RowReadings,
    plain_timecode,
    read_text,
)

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
    for at, line in enumerate(lines, 1):
        word = line.strip().lower()
        if word in ("heading", "column", "data"):
            section = word
        elif word and section in ("column", "data"):
            rows.append((at, [cell.strip() for cell in line.split("\t")]))
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


KIND = "Avid Log Exchange file"
_NAMES = ("name", "clip name", "source file", "source file name", "clip")
_QUANTITIES = (
    "focal_length_mm",
    "f_number",
    "t_number",
    "focus_distance_mm",
    "lens_model",
    "lens_serial",
)
_BREAKS = "._- "
_REMEDY = "name the plates as the clip, or give them its timecode"


class _Clip(NamedTuple):
    """A row: its line, names without ending, timecodes, and what it says."""

    line: int
    names: tuple[str, ...]
    start: str | None
    end: str | None
    readings: Readings


@final
class AleClips(CameraFile):
    """The clips of an ALE."""

    def __init__(self, path: Path, clips: Sequence[_Clip]):
        self.path, self.kind, self.notes = path, KIND, ()
        self.clips = tuple(clips)

    def at(self, frame: FrameKey, first_frame: int | None) -> tuple[Readings, str]:
        """What is known of the clip that a frame belongs to, and its line."""
        clip = self._clip(frame)
        return clip.readings, f"line {clip.line}"

    def lacks(self, frame: FrameKey, first_frame: int | None) -> frozenset[str]:
        """None: a clip tells all of its frames the same."""
        return frozenset()

    def _clip(self, frame: FrameKey) -> _Clip:
        if len(self.clips) == 1:
            return self.clips[0]
        found = [clip for clip in self.clips if _is_named(clip, frame.stem or "")]
        found = found or [clip for clip in self.clips if _holds(clip, frame.timecode)]
        if not found:
            known = ", ".join(clip.names[0] for clip in self.clips[:5] if clip.names)
            raise CameraError(
                f"has no clip of {frame.stem!r}, by name or timecode (it has {known})",
                where=self.path,
                remedy=_REMEDY,
            )
        if any(clip.readings != found[0].readings for clip in found):
            lines = ", ".join(str(clip.line) for clip in found[:5])
            raise CameraError(
                f"has several clips of {frame.stem!r} that differ (lines {lines})",
                where=self.path,
                remedy=_REMEDY,
            )
        return found[0]


def read_ale(path: str | Path) -> AleClips:
    """The clips of an Avid Log Exchange file.

    Raises
    ------
    CameraError : It has no rows or no column of the lens, or a cell holds what it may
        not.
    """
    path = Path(path)
    lines = ale_rows(read_text(path).splitlines())
    if len(lines) < 2 or len(lines) > MOST_ROWS:
        raise CameraError(
            f"has {max(len(lines) - 1, 0)} clips, and 1 to {MOST_ROWS} are read",
            where=path,
            remedy="export it again, tab-separated",
        )
    (_, names), *rows = lines
    places = {k: v for k, v in places_of_columns(names).items() if k in _QUANTITIES}
    if not places:
        raise CameraError(
            f"is an {KIND} without a column of the lens",
            where=path,
            remedy='name columns "Focal Length", "F-Stop", "T-Stop", "Focus Distance"',
        )
    plain = [name.strip().lower() for name in names]
    return AleClips(path, [_row(path, line, c, plain, places) for line, c in rows])


def _row(
    path: Path,
    line: int,
    cells: Sequence[str],
    columns: Sequence[str],
    places: Mapping[str, int],
) -> _Clip:
    texts = {
        name: cell
        for name, cell in zip(columns, cells, strict=False)
        if not is_missing(cell)
    }
    found = RowReadings(path, line)
    for quantity, place in places.items():
        text = texts.get(columns[place])
        if text is not None:
            _put(found, quantity, text, columns[place])
    stems = (texts[n] for n in _NAMES if n in texts)
    own = tuple(Path(stem.replace("\\", "/")).stem for stem in stems)
    start, end = (plain_timecode(texts.get(name)) for name in ("start", "end"))
    return _Clip(line, own, start, end, dict(found))


def _put(found: RowReadings, quantity: str, text: str, column: str) -> None:
    """What a cell says, as people write it: 50mm, T2.8, 1.4 + 7/10, 4'11"."""
    with found.naming_line():
        if quantity in ("f_number", "t_number"):
            letter, value = stop(text, column)
            known = {"F": "f_number", "T": "t_number", None: quantity}[letter]
            found.put(known, value, column)
        elif quantity == "focus_distance_mm":
            found.put(quantity, written_length_mm(text, column), column)
        elif quantity == "focal_length_mm":
            plain = text.lower().removesuffix("mm")
            found.put(quantity, number(plain, column), column)
        else:
            found.put(quantity, text, column)


def _is_named(clip: _Clip, stem: str) -> bool:
    """Whether a plate's name begins with one of the clip's, up to a break."""
    for name in clip.names:
        rest = stem.lower().removeprefix(name.lower())
        if name and rest != stem.lower() and (not rest or rest[0] in _BREAKS):
            return True
    return False


def _holds(clip: _Clip, timecode: str | None) -> bool:
    if timecode is None or clip.start is None or clip.end is None:
        return False
    return clip.start <= timecode < clip.end

"""The table of a camera file, read within bounds, and its values at a frame.

How many lines and columns there are, and how long, is bounded like the size of a file
(`lensfit.bounded`).

The rows of a sidecar belong to frames by timecode, or by counting from a stated first
frame; those of a match-moved camera carry the plate's own frame numbers. A table whose
rows are all alike, such as that of an untouched prime, needs neither.
"""

import csv
import io
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, final

from lensfit.bounded import read_beginning, read_bounded, utf8_text
from lensfit.errors import CameraError
from lensfit.io.camera.quantity import (
    Reading,
    checked_quantity,
    error_at_line,
    is_missing,
    number,
)

MOST_BYTES = 64 << 20
MOST_ROWS = 200_000
MOST_COLUMNS = 4096
MOST_LINES = 20 * MOST_ROWS
_SNIFFED = 1 << 16
_LONGEST_CELL = 1 << 16
_LONGEST_LINE = 1 << 16
_CUT = "cut it to the frames of the shot"


def read_text(path: str | Path, most_bytes: int = MOST_BYTES) -> str:
    """The text of a file, UTF-8.

    Raises
    ------
    CameraError : It cannot be read, is empty, too large or no text.
    """
    path = Path(path)
    data = read_bounded(path, most_bytes, error=CameraError, too_large=_CUT)
    if not data.strip():
        raise CameraError("is empty", where=path)
    return utf8_text(data, path, error=CameraError, remedy="export it again, as UTF-8")


def read_lines(path: str | Path) -> Iterator[tuple[int, str]]:
    """Number and text of each line of a file.

    Raises
    ------
    CameraError : As `read_text`, or it has more lines than any camera writes.
    """
    for at, line in enumerate(io.StringIO(read_text(path)), 1):
        if at > MOST_LINES:
            raise CameraError(
                f"has more than {MOST_LINES} lines",
                where=path,
                remedy=_CUT,
            )
        if len(line) > _LONGEST_LINE:
            raise CameraError(
                f"line {at} is longer than any that a camera writes", where=path
            )
        yield at, line.rstrip("\n")


def sniff(path: str | Path) -> str:
    """The beginning of a file, whatever its encoding; for telling its kind.

    Raises
    ------
    CameraError : It cannot be read.
    """
    beginning = read_beginning(Path(path), _SNIFFED, error=CameraError)
    return beginning.decode("utf-8-sig", "replace")


class Sheet(NamedTuple):
    """A table of cells with names for its columns.

    Attributes
    ----------
    columns : Places of each name; the same name may stand over several columns.
    rows : Line number and cells of each row, read when requested.
    """

    columns: dict[str, list[int]]
    rows: Iterator[tuple[int, list[str]]]

    def cell(self, cells: Sequence[str], name: str) -> str | None:
        """What a row has under a name; None where it is missing."""
        for place in self.columns.get(name, ()):
            if place < len(cells) and not is_missing(cells[place]):
                return cells[place].strip()
        return None


def read_sheet(path: str | Path, delimiter: str) -> Sheet:
    """A table whose first line names the columns.

    Raises
    ------
    CameraError : The file cannot be read as text, has no row, or more rows or columns
        than any camera writes; the rows' own are raised when they are requested.
    """
    path = Path(path)
    lines = _within_bounds(io.StringIO(read_text(path), newline=""), delimiter, path)
    rows = _rows(csv.reader(lines, delimiter=delimiter), path)
    first = next(rows, None)
    columns: dict[str, list[int]] = {}
    for place, name in enumerate(first[1] if first else ()):
        columns.setdefault(name.strip(), []).append(place)
    return Sheet(columns, rows)


def _within_bounds(lines: Iterable[str], delimiter: str, path: Path) -> Iterator[str]:
    for at, line in enumerate(lines, 1):
        if at > MOST_ROWS + 1:
            raise CameraError(
                f"has more than {MOST_ROWS} rows",
                where=path,
                remedy=_CUT,
            )
        if line.count(delimiter) >= MOST_COLUMNS:
            raise CameraError(
                f"line {at} has more than {MOST_COLUMNS} columns, which no camera "
                "writes",
                where=path,
            )
        yield line


def _rows(reader, path: Path) -> Iterator[tuple[int, list[str]]]:
    csv.field_size_limit(_LONGEST_CELL)
    try:
        for cells in reader:
            if any(cell and not cell.isspace() for cell in cells):
                yield reader.line_num, cells
    except csv.Error as error:
        raise CameraError(
            f"line {reader.line_num} is no row of a table: {error}", where=path
        ) from error


Readings = Mapping[str, Reading]

_TIMECODE = re.compile(
    r"(\d{1,2})[:;.](\d{1,2})[:;.](\d{1,2})[:;.,](\d{1,3})(?:\.\d+)?"
)


class FrameKey(NamedTuple):
    """What tells a frame from others.

    Attributes
    ----------
    number : In the name of its file.
    timecode : Of its header, as `plain_timecode` spells it.
    stem : The name of its file, without its ending.
    """

    number: int | None = None
    timecode: str | None = None
    stem: str | None = None


class CameraFile(ABC):
    """A file that knows the camera.

    Attributes
    ----------
    path : The file.
    kind : What it is, in words.
    notes : Notes on how it is read.
    """

    path: Path
    kind: str
    notes: tuple[str, ...]

    @abstractmethod
    def at(self, frame: FrameKey, first_frame: int | None) -> tuple[Readings, str]:
        """What is known at a frame, by quantity, and where in the file it stands.

        Parameters
        ----------
        first_frame : Frame number of the first row, of tables without frame numbers.

        Raises
        ------
        CameraError : The frame is not in the file, or cannot be told from others.
        """

    @abstractmethod
    def lacks(self, frame: FrameKey, first_frame: int | None) -> frozenset[str]:
        """Quantities that the file tells of other frames, and not of this one.

        Raises
        ------
        CameraError : The frame is not in the file, or cannot be told from others.
        """


class Row(NamedTuple):
    """One row: its line in the file, its timecode or frame number, what it says."""

    line: int
    readings: Readings
    timecode: str | None = None
    number: int | None = None


@final
class CameraTable(CameraFile):
    """A table with a row for each frame, or with one for the whole clip."""

    def __init__(
        self,
        path: Path,
        kind: str,
        rows: Sequence[Row],
        notes: Iterable[str] = (),
    ):
        if not rows:
            raise CameraError(f"is a {kind} without rows", where=path)
        self.path, self.kind, self.notes = path, kind, tuple(notes)
        self.rows = tuple(rows)
        self._quantities = _known_quantities(row.readings for row in rows)
        self._alike = all(row.readings == rows[0].readings for row in rows)
        self._by_number = {row.number: row for row in rows if row.number is not None}
        self._by_timecode: dict[str, list[Row]] = {}
        for row in rows:
            if row.timecode is not None:
                self._by_timecode.setdefault(row.timecode, []).append(row)

    def at(self, frame: FrameKey, first_frame: int | None) -> tuple[Readings, str]:
        """What is known at a frame, by quantity, and where in the file it stands."""
        row = self._row(frame, first_frame)
        return row.readings, f"line {row.line}"

    def lacks(self, frame: FrameKey, first_frame: int | None) -> frozenset[str]:
        """Quantities that other rows tell, and this one marks as unknown."""
        return self._quantities - _known_quantities(
            [self._row(frame, first_frame).readings]
        )

    def _row(self, frame: FrameKey, first_frame: int | None) -> Row:
        if self._by_number:
            if frame.number in self._by_number:
                return self._by_number[frame.number]
            return self._one_or(
                f"does not know frame {frame.number}"
                if frame.number is not None
                else "has many frames, and the plate's name has no frame number",
                "export the camera over the whole shot",
            )
        if first_frame is not None:
            return self._row_of_frame(frame, first_frame)
        if frame.timecode is not None and self._by_timecode:
            return self._row_of_timecode(frame.timecode)
        return self._one_or(
            "cannot tell which row belongs to a frame: the plate has no timecode"
            if self._by_timecode
            else "cannot tell which row belongs to a frame: its rows have no timecode",
            "give the frame number of its first row with --metadata-start",
        )

    def _row_of_frame(self, frame: FrameKey, first_frame: int) -> Row:
        if frame.number is None:
            return self._one_or(
                "cannot count its rows: the plate's name has no frame number",
                "name the plate as plate.1001.exr",
            )
        place = frame.number - first_frame
        if 0 <= place < len(self.rows):
            return self.rows[place]
        last = first_frame + len(self.rows) - 1
        raise CameraError(
            f"has rows for frames {first_frame} to {last} and none for {frame.number}",
            where=self.path,
            remedy="give the frame number of its first row with --metadata-start",
        )

    def _row_of_timecode(self, timecode: str) -> Row:
        rows = self._by_timecode.get(timecode, ())
        if not rows:
            first, last = self.rows[0].timecode, self.rows[-1].timecode
            raise CameraError(
                f"has no row of timecode {timecode} (its rows go from {first} to "
                f"{last})",
                where=self.path,
                remedy="give the frame number of its first row with --metadata-start",
            )
        if any(row.readings != rows[0].readings for row in rows):
            raise CameraError(
                f"has {len(rows)} rows of timecode {timecode} that differ",
                where=self.path,
                remedy="give the frame number of its first row with --metadata-start",
            )
        return rows[0]

    def _one_or(self, what: str, remedy: str) -> Row:
        """Any row, if all say the same and none is a frame's own."""
        if self._alike and (len(self.rows) == 1 or not self._by_number):
            return self.rows[0]
        raise CameraError(what, where=self.path, remedy=remedy)


def _known_quantities(rows: Iterable[Readings]) -> frozenset[str]:
    """Quantities that any row tells; a T-stop stands for the f-number, a pinhole's
    focal length for the ring's."""
    names = frozenset(name for readings in rows for name in readings)
    stands_for = {"t_number": "f_number", "pinhole_focal_length_mm": "focal_length_mm"}
    return names | {stands_for[name] for name in names & stands_for.keys()}


class RowReadings(dict[str, Reading]):
    """Readings of one row as they are found; errors name the line."""

    def __init__(self, path: Path, line: int):
        super().__init__()
        self.path, self.line = path, line

    @contextmanager
    def naming_line(self) -> Iterator[None]:
        """Errors of what is read meanwhile name the line, unless they do already."""
        try:
            yield
        except CameraError as error:
            if error.where is not None:
                raise
            raise error_at_line(error, self.path, self.line) from None

    def put(self, name: str, value: float | str | None, entry: str) -> None:
        """Keep a value, unless it is None, or 0, which sidecars write for unknown."""
        if isinstance(value, str):
            self[name] = Reading(value[:200], entry)
        elif value is not None:
            try:
                known = checked_quantity(name, value, entry)
            except CameraError as error:
                raise error_at_line(error, self.path, self.line) from None
            if known is not None:
                self[name] = Reading(known, entry)

    def number(self, text: str | None, entry: str) -> float | None:
        """The number in a cell, if there is a cell."""
        if text is None:
            return None
        try:
            return number(text, entry)
        except CameraError as error:
            raise error_at_line(error, self.path, self.line) from None


def rows_with_shared_readings(rows: Iterable[Row]) -> list[Row]:
    """The rows, with neighbours that say the same sharing their readings: a prime's
    table of an hour then takes a few megabytes."""
    kept: list[Row] = []
    for row in rows:
        if kept and kept[-1].readings == row.readings:
            row = row._replace(readings=kept[-1].readings)
        else:
            row = row._replace(readings=dict(row.readings))
        kept.append(row)
    return kept


def plain_timecode(text: object) -> str | None:
    """A timecode as 01:02:03:04, whatever separates its parts; None if it is none."""
    if all(hasattr(text, part) for part in ("hours", "minutes", "seconds", "frame")):
        parts = (text.hours, text.minutes, text.seconds, text.frame)  # pyright: ignore
        return "{:02d}:{:02d}:{:02d}:{:02d}".format(*map(int, parts))
    match = _TIMECODE.fullmatch(text.strip()) if isinstance(text, str) else None
    if match is None:
        return None
    return ":".join(f"{int(part):02d}" for part in match.groups())

"""Lines and tables of sidecars, read within bounds.

How many lines and columns there are, and how long, is bounded like the size of a file
(`lensfit.bounded`).
"""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from lensfit.bounded import read_beginning, read_bounded, utf8_text
from lensfit.errors import CameraError
from lensfit.io.camera.quantity import is_missing

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

"""Text files of unknown origin, read within bounds.

A sidecar comes from another program, a card reader or a mail: its size, lines and
columns are bounded before anything is built from them, so that a broken or hostile
file costs one error line, not the machine.
"""

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from lensfit.errors import CameraError
from lensfit.io.camera.quantity import is_missing

MOST_BYTES = 64 << 20
MOST_ROWS = 200_000
MOST_COLUMNS = 4096
MOST_LINES = 20 * MOST_ROWS
_SNIFFED = 1 << 16
_LONGEST_CELL = 1 << 16
_LONGEST_LINE = 1 << 16


def read_text(path: str | Path, most_bytes: int = MOST_BYTES) -> str:
    """The text of a file, UTF-8.

    Raises
    ------
    CameraError : It cannot be read, is empty, too large or no text.
    """
    path = Path(path)
    data = _read(path, most_bytes + 1)
    if len(data) > most_bytes:
        raise CameraError(
            f"is larger than {most_bytes >> 20} MiB, which no camera file is",
            where=path,
            remedy="cut it to the frames of the shot",
        )
    if not data.strip():
        raise CameraError("is empty", where=path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _no_text(path, f"byte {error.start} is not UTF-8") from None
    if "\0" in text:
        raise _no_text(path, "it holds NUL bytes")
    return text


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
                remedy="cut it to the frames of the shot",
            )
        if len(line) > _LONGEST_LINE:
            raise CameraError(
                f"line {at} is longer than any that a camera writes", where=path
            )
        yield at, line.rstrip("\n")


def sniff(path: str | Path) -> str:
    """The beginning of a file, whatever its encoding; for telling its kind."""
    return _read(Path(path), _SNIFFED).decode("utf-8-sig", "replace")


class Sheet(NamedTuple):
    """A table of cells with names for its columns.

    Attributes
    ----------
    columns : Places of each name; the same name may stand over several columns.
    rows : Line number and cells of each row, read as they are asked for.
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
        than any camera writes; the rows' own are raised when they are asked for.
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
                remedy="cut it to the frames of the shot",
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


def _read(path: Path, most_bytes: int) -> bytes:
    try:
        if path.exists() and not path.is_file():
            raise CameraError("is no file", where=path)
        with path.open("rb") as file:
            return file.read(most_bytes)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise CameraError(f"cannot be read ({reason})", where=path) from error


def _no_text(path: Path, why: str) -> CameraError:
    return CameraError(
        f"is not text: {why}", where=path, remedy="export it again, as UTF-8"
    )

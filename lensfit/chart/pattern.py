"""What a chart shows, in millimetres: dots, lines, a checkerboard, and the code of it.

A pattern, and the discs, stripes or squares that it is drawn with.

Lattice coordinates are those of `lensfit.detect.observations`, counted from the chart's
own first mark: (0, 0) is the top left dot, crossing or inner corner of the upright
chart, i to the right, j down.

Orientation marks break the symmetry of the grid. They are four sites near its middle,
no two of which can be confused with others after any quarter turn or in a mirror: dots
that are missing, or small discs in the middle of cells. Nothing a detector measures is
near them.

The code is a strip of fourteen markers of OpenCV's dictionary DICT_5X5_1000, of which
two wrong bits each are mended. The id of a marker is ``71 * position + digit``, so
every marker knows its place in the strip: they may be read in any order, from several
strips, turned or tilted. The digits, base 71, most significant first, are one whole
number: the pattern's fields and a checksum (CRC-16/CCITT-FALSE). On a dark sheet the
markers are inverted.

A marker is 7 x 7 modules with its frame, with one module between; the strip measures
113 x 9 modules with its quiet zone. On photographs a module needs about 2 pixels.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.chart.drawing import Layer
from lensfit.errors import ChartError

ChartKind = Literal["dot-grid", "line-grid", "checkerboard"]
Polarity = Literal["bright", "dark"]
KINDS: tuple[ChartKind, ...] = get_args(ChartKind)
POLARITIES: tuple[Polarity, ...] = get_args(Polarity)

STEP_MM = 1e-4
"""Lengths of a pattern are whole multiples: as much as a chart can say of itself."""
MOST_MARKS = 255
FEWEST_MARKS = 5
LINE_END = 0.5
"""How far a line goes on beyond its last crossing, in pitches: no further, or its end
looks like one more crossing."""
ORIENTATION_CELLS = np.array([[0, 0], [2, 0], [5, 0], [0, 3]])
"""Orientation marks, in sites from the first one."""
_ORIENTATION_SPAN = ORIENTATION_CELLS.max(0) + 1
_DISC_PART = {"line-grid": 0.2, "checkerboard": 0.2}
"""Diameter of an orientation mark, in pitches: clear of what the detectors measure."""


@dataclass(frozen=True)
class Pattern:
    """The grid of a chart.

    Attributes
    ----------
    pitch_mm : Distance of neighbouring marks; side of a checker square.
    mark_mm : Diameter of a dot or width of a line; 0 for a checkerboard.
    columns, rows : Dots or lines; squares of a checkerboard.
    oriented : Orientation marks are there.
    """

    kind: ChartKind
    polarity: Polarity
    pitch_mm: float
    mark_mm: float
    columns: int
    rows: int
    oriented: bool

    @property
    def lattice_size(self) -> tuple[int, int]:
        """Columns and rows of what a detector numbers: dots, crossings or corners."""
        less = 1 if self.kind == "checkerboard" else 0
        return self.columns - less, self.rows - less

    @property
    def site_offset(self) -> float:
        """From a lattice point to the site of the same number, in both directions."""
        return 0.0 if self.kind == "dot-grid" else 0.5

    @property
    def first_orientation_site(self) -> Int[np.ndarray, " 2"]:
        """Column and row of the site that `ORIENTATION_CELLS` count from."""
        sites = np.array(self.lattice_size) - (self.site_offset > 0)
        return (sites - _ORIENTATION_SPAN) // 2

    @property
    def orientation_marks(self) -> Float[np.ndarray, "marks 2"]:
        """Their lattice coordinates; none if the chart is not oriented."""
        cells = ORIENTATION_CELLS if self.oriented else ORIENTATION_CELLS[:0]
        return cells + self.first_orientation_site + self.site_offset

    @property
    def orientation_mark_mm(self) -> float:
        """Diameter of an orientation mark; 0 where it is a missing dot."""
        return _DISC_PART.get(self.kind, 0.0) * self.pitch_mm


def make_pattern(
    kind: ChartKind,
    polarity: Polarity,
    pitch_mm: float,
    mark_mm: float,
    columns: int,
    rows: int,
) -> Pattern:
    """A pattern with orientation marks, if it has room for them.

    Raises
    ------
    ChartError : Too few or too many marks, or marks as wide as their pitch.
    """
    name = kind.replace("-", " ")
    if min(columns, rows) < FEWEST_MARKS:
        raise ChartError(
            f"the {name} would have {columns} x {rows} marks, and {FEWEST_MARKS} each "
            "way are needed",
            remedy="use a smaller pitch or a larger sheet",
        )
    if max(columns, rows) > MOST_MARKS:
        raise ChartError(
            f"the {name} would have {columns} x {rows} marks, more than {MOST_MARKS}",
            remedy="use a larger pitch",
        )
    if kind != "checkerboard" and not 0 < mark_mm < 0.9 * pitch_mm:
        raise ChartError(
            f"marks of {mark_mm:g} mm do not suit a pitch of {pitch_mm:g} mm",
            remedy="make them narrower than 0.9 pitches",
        )
    plain = Pattern(kind, polarity, pitch_mm, mark_mm, columns, rows, False)
    oriented = bool((plain.first_orientation_site >= 1).all())
    return Pattern(kind, polarity, pitch_mm, mark_mm, columns, rows, oriented)


def pattern_layers(
    pattern: Pattern, origin_mm: tuple[float, float], ink: float, ground: float
) -> tuple[Layer, ...]:
    """What to draw, in order.

    Parameters
    ----------
    origin_mm : Place of lattice point (0, 0) on the sheet.
    ink, ground : Tones of marks and of what they lie on.
    """
    if pattern.kind == "dot-grid":
        return (Layer(ink, discs_mm=_dots(pattern, origin_mm)),)
    marks = pattern.orientation_marks * pattern.pitch_mm + origin_mm
    discs = _discs(marks, pattern.orientation_mark_mm)
    if pattern.kind == "line-grid":
        upright, level = _stripes(pattern, origin_mm)
        return (
            Layer(ink, boxes_mm=upright),
            Layer(ink, boxes_mm=level),
            Layer(ink, discs_mm=discs),
        )
    inked = _is_inked(pattern.orientation_marks)
    return (
        Layer(ink, boxes_mm=_squares(pattern, origin_mm)),
        Layer(ground, discs_mm=discs[inked]),
        Layer(ink, discs_mm=discs[~inked]),
    )


def lattice_points(pattern: Pattern) -> Float[np.ndarray, "points 2"]:
    """Lattice coordinates of all dots, crossings or inner corners, row by row."""
    columns, rows = pattern.lattice_size
    j, i = np.mgrid[:rows, :columns]
    return np.stack([i.ravel(), j.ravel()], -1).astype(float)


def _dots(pattern: Pattern, origin_mm: tuple[float, float]) -> np.ndarray:
    points = lattice_points(pattern)
    missing = (points[:, None] == pattern.orientation_marks).all(-1).any(-1)
    return _discs(points[~missing] * pattern.pitch_mm + origin_mm, pattern.mark_mm)


def _discs(centres_mm: np.ndarray, diameter_mm: float) -> np.ndarray:
    return np.column_stack([centres_mm, np.full(len(centres_mm), diameter_mm / 2)])


def _stripes(
    pattern: Pattern, origin_mm: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Upright and level lines."""
    families = []
    for axis in (0, 1):
        count, other = pattern.lattice_size[axis], pattern.lattice_size[1 - axis]
        boxes = np.empty((count, 4))
        boxes[:, axis] = np.arange(count) * pattern.pitch_mm - pattern.mark_mm / 2
        boxes[:, 1 - axis] = -LINE_END * pattern.pitch_mm
        boxes[:, :2] += origin_mm
        boxes[:, 2 + axis] = pattern.mark_mm
        boxes[:, 3 - axis] = (other - 1 + 2 * LINE_END) * pattern.pitch_mm
        families.append(boxes)
    return families[0], families[1]


def _squares(pattern: Pattern, origin_mm: tuple[float, float]) -> np.ndarray:
    j, i = np.mgrid[: pattern.rows, : pattern.columns]
    place = np.stack([i[(i + j) % 2 == 0], j[(i + j) % 2 == 0]], -1) - 1.0
    corner = place * pattern.pitch_mm + origin_mm
    return np.column_stack([corner, np.full_like(corner, pattern.pitch_mm)])


def _is_inked(sites: np.ndarray) -> np.ndarray:
    """Whether the square around a site is inked: the top left one of the board is."""
    return np.floor(sites + 1).sum(-1) % 2 == 0


def nearest_printable_length_mm(length_mm: float) -> float:
    """The nearest length that a chart can say of itself."""
    return round(round(length_mm / STEP_MM) * STEP_MM, 4)


MARKERS = 14
BASE = 71
MARKER_MODULES = 7
STRIP_MODULES = (MARKERS * (MARKER_MODULES + 1) + 1, MARKER_MODULES + 2)
_VERSION = 1
_FIELD_BITS = (2, 2, 1, 24, 22, 8, 8, 1)
"""Version, kind, polarity, pitch and mark in steps, columns, rows, oriented."""
_CHECK_BITS = 16


def marker_ids(pattern: Pattern) -> tuple[int, ...]:
    """Ids of the markers of the strip, from left to right."""
    fields = (
        _VERSION,
        KINDS.index(pattern.kind),
        POLARITIES.index(pattern.polarity),
        round(pattern.pitch_mm / STEP_MM),
        round(pattern.mark_mm / STEP_MM),
        pattern.columns,
        pattern.rows,
        int(pattern.oriented),
    )
    number = 0
    for value, bits in zip(fields, _FIELD_BITS, strict=True):
        if not 0 <= value < 1 << bits:
            raise ValueError(f"{value} does not fit {bits} bits")
        number = number << bits | value
    number = number << _CHECK_BITS | _checksum(number)
    digits = [number // BASE ** (MARKERS - 1 - k) % BASE for k in range(MARKERS)]
    return tuple(BASE * k + digit for k, digit in enumerate(digits))


def pattern_of(ids: tuple[int, ...]) -> Pattern | None:
    """The pattern that a whole strip of ids describes; None if its checksum is wrong.

    Parameters
    ----------
    ids : One for each position, in order.
    """
    number = 0
    for k, marker in enumerate(ids):
        number = number * BASE + marker - BASE * k
    content, check = number >> _CHECK_BITS, number & (1 << _CHECK_BITS) - 1
    if content >> sum(_FIELD_BITS) or _checksum(content) != check:
        return None
    values = []
    for bits in reversed(_FIELD_BITS):
        values.append(content & (1 << bits) - 1)
        content >>= bits
    version, kind, polarity, pitch, mark, columns, rows, oriented = reversed(values)
    if version != _VERSION or kind >= len(KINDS):
        return None
    return Pattern(
        KINDS[kind],
        POLARITIES[polarity],
        round(pitch * STEP_MM, 4),
        round(mark * STEP_MM, 4),
        columns,
        rows,
        bool(oriented),
    )


def marker_cells(marker: int) -> Bool[np.ndarray, "7 7"]:
    """Which modules of a marker are black on a white sheet, row 0 on top."""
    size = MARKER_MODULES
    return cv2.aruco.generateImageMarker(dictionary(), marker, size, borderBits=1) == 0


@cache
def dictionary() -> Any:
    """OpenCV's dictionary that the strip is written in."""
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_1000)


def _checksum(number: int) -> int:
    """CRC-16/CCITT-FALSE of the number's bytes."""
    crc = 0xFFFF
    for byte in number.to_bytes((sum(_FIELD_BITS) + 7) // 8, "big"):
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc

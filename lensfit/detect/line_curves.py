"""Where the lines of an indexed grid run, and which pieces of them to measure.

A curve through the indexed crossings of one line predicts it to about a pixel, also
across a crossing that was not found and for one pitch beyond the last. The parameter
along a line is the lattice coordinate, so every piece knows its own. Pieces keep so
far from every crossing, seen or due, that the other line does not enter the window
across them, however obliquely the two meet, and are left out where the next parallel
line would.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline

from lensfit.detect.line_profile import Window

CROSSINGS_OF_AN_END = 5
"""How many crossings the parabola that continues a line beyond its end is fitted to."""
CLEARANCE = 1.3
"""Distance kept from the middle of the crossing line, in its own half widths."""


@dataclass(frozen=True)
class Pieces:
    """Pieces of line to measure, with tangent and bend per pitch along the line."""

    family: Int[np.ndarray, " pieces"]
    number: Int[np.ndarray, " pieces"]
    along: Float[np.ndarray, " pieces"]
    points_px: Float[np.ndarray, "pieces 2"]
    tangent_px: Float[np.ndarray, "pieces 2"]
    bend_px: Float[np.ndarray, "pieces 2"]


def cut_pieces(
    indices: Int[np.ndarray, "crossings 2"],
    crossings_px: Float[np.ndarray, "crossings 2"],
    window: Window,
) -> Pieces:
    """Every measurable piece of every line with at least two crossings.

    Parameters
    ----------
    indices : Lattice coordinates of the crossings.
    crossings_px : Their positions, pixels.
    window : What is going to be read around each piece.
    """
    lines = list(_lines(indices))
    tangents = np.full((2, *crossings_px.shape), np.nan)
    for family, _, members, along in lines:
        points = crossings_px[members]
        tangents[family, members] = _follow(along, points, along)[1]
    tables = [np.zeros((0, 9))]
    for family, number, members, along in lines:
        others = _without_gaps(tangents[1 - family, members])
        pieces = _cut_line(along, crossings_px[members], others, window)
        label = np.tile([float(family), float(number)], (len(pieces), 1))
        tables.append(np.hstack([label, pieces]))
    table = np.concatenate(tables)
    return Pieces(
        family=table[:, 0].astype(int),
        number=table[:, 1].astype(int),
        along=table[:, 2],
        points_px=table[:, 3:5],
        tangent_px=table[:, 5:7],
        bend_px=table[:, 7:9],
    )


def move_crossings(
    indices: Int[np.ndarray, "crossings 2"],
    crossings_px: Float[np.ndarray, "crossings 2"],
    pieces: Pieces,
    shift_px: Float[np.ndarray, "pieces 2"],
) -> Float[np.ndarray, "crossings 2"]:
    """Crossings moved to where the measured lines meet.

    Parameters
    ----------
    indices, crossings_px : The crossings that predicted the pieces.
    pieces : The measured pieces.
    shift_px : How far each piece lies from its prediction; NaN if not measured.
    """
    normals = np.tile(np.eye(2), (len(crossings_px), 1, 1))
    shifts = np.zeros((len(crossings_px), 2))
    measured = np.isfinite(shift_px[:, 0])
    normal = pieces.tangent_px[:, ::-1] * [1.0, -1.0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = (normal * shift_px).sum(1)
    for family, number, members, along in _lines(indices):
        own = measured & (pieces.family == family) & (pieces.number == number)
        if not own.any():
            continue
        order = np.argsort(pieces.along[own])
        at = pieces.along[own][order]
        shifts[members, family] = np.interp(along, at, across[own][order])
        for axis in (0, 1):
            component = normal[own, axis][order]
            normals[members, family, axis] = np.interp(along, at, component)
    oblique = np.abs(np.linalg.det(normals)) > 0.1
    moved = crossings_px.copy()
    step = np.linalg.solve(normals[oblique], shifts[oblique][..., None])[..., 0]
    moved[oblique] += step
    return moved


def _lines(indices: np.ndarray):
    """Family, number, members in order and their coordinates, of each line."""
    for family in (0, 1):
        for number in np.unique(indices[:, family]):
            members = np.flatnonzero(indices[:, family] == number)
            along = indices[members, 1 - family].astype(float)
            order = np.argsort(along)
            if len(members) > 1:
                yield family, int(number), members[order], along[order]


def _without_gaps(vectors: np.ndarray) -> np.ndarray:
    """Rows that are NaN replaced by the nearest row that is not."""
    known = np.flatnonzero(np.isfinite(vectors[:, 0]))
    if not len(known):
        return vectors
    rows = np.arange(len(vectors))
    return vectors[known[np.abs(rows[:, None] - known).argmin(1)]]


def _cut_line(
    along: np.ndarray, points: np.ndarray, others: np.ndarray, window: Window
) -> np.ndarray:
    """Rows of (along, x, y, tangent x, y, bend x, y)."""
    nodes = np.arange(along[0] - 1, along[-1] + 2)
    place, tangent, _ = _follow(along, points, nodes)
    across = others[np.abs(nodes[:, None] - along).argmin(1)]
    clearance, room = _clearance(tangent, across, window)
    reach = window.reach_px + window.half_width_px
    centres = []
    for k, length in enumerate(np.linalg.norm(np.diff(place, axis=0), axis=1)):
        free = length - clearance[k] - clearance[k + 1]
        if np.isfinite(free) and free >= window.rows and min(room[k : k + 2]) > reach:
            count = int(free // window.rows)
            offset = (np.arange(count) + 0.5) / count * free + clearance[k]
            centres.append(nodes[k] + offset / length)
    if not centres:
        return np.zeros((0, 7))
    s = np.concatenate(centres)
    return np.column_stack([s, *_follow(along, points, s)])


def _clearance(
    tangent: np.ndarray, across: np.ndarray, window: Window
) -> tuple[np.ndarray, np.ndarray]:
    """Distance to keep from each crossing along the line, and room beside the line.

    The window extends along x for a line nearer to upright, else along y; room is the
    distance in that direction to the next parallel line. NaN where the other family's
    direction is unknown.
    """

    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])

    upright = np.abs(tangent[:, 1:]) >= np.abs(tangent[:, :1])
    axis = np.where(upright, [1.0, 0.0], [0.0, 1.0])
    unit = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    other = across / np.linalg.norm(across, axis=1, keepdims=True)
    half = CLEARANCE * (window.half_width_px + window.fade_px)
    with np.errstate(divide="ignore", invalid="ignore"):
        clearance = (half + window.reach_px * cross(axis, other)) / cross(unit, other)
        room = cross(across, unit) / cross(axis, unit)
    return clearance, room


def _follow(
    along: np.ndarray, points: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, first and second derivative of the curve at the coordinates `s`."""
    if len(along) < 4:
        curve = np.polynomial.Polynomial
        fits = [curve.fit(along, p, len(along) - 1) for p in points.T]
        derivatives = [
            np.stack([fit.deriv(k)(s) if k else fit(s) for fit in fits], -1)
            for k in range(3)
        ]
        return derivatives[0], derivatives[1], derivatives[2]
    spline = CubicSpline(along, points)
    position, tangent, bend = spline(s), spline(s, 1), spline(s, 2)
    first, last = slice(CROSSINGS_OF_AN_END), slice(-CROSSINGS_OF_AN_END, None)
    for outside, end in ((s < along[0], first), (s > along[-1], last)):
        parabola = np.polynomial.polynomial.polyfit(along[end], points[end], 2)
        beyond = s[outside][:, None]
        position[outside] = parabola[0] + parabola[1] * beyond + parabola[2] * beyond**2
        tangent[outside] = parabola[1] + 2 * parabola[2] * beyond
        bend[outside] = 2 * parabola[2]
    return position, tangent, bend

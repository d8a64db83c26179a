"""The chart in front of the lens: what it carries, and how it stands.

Chart millimetres: X right, Y down on an upright chart, origin at its centre, where mark
(0, 0) of a dot grid lies. Pose: P = R (X, Y, bend) + (shift_x, shift_y, distance) in
object space (x right, y down, z distance from the sensor), with the rotation
R = Rz(roll) Ry(pan) Rx(tilt). The chart may be bent into a paraboloid.
"""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import cv2
import numba as nb
import numpy as np
from jaxtyping import Bool, Float

ChartKind = Literal["dot-grid", "line-grid", "checkerboard", "charuco"]
MARKER_RATIO, DICTIONARY = 0.7, "DICT_5X5_1000"
"""Of ChArUco boards: side of a marker over that of its square, and OpenCV's markers."""
SQUARE_PX = 80
"""Of the picture of a board: a module of these markers is eight pixels wide."""


@dataclass(frozen=True)
class Chart:
    """A bright pattern on black, or dark dots on white.

    Attributes
    ----------
    kind : Round holes, bright lines, a checkerboard (white square at X, Y > 0), or a
        ChArUco board on white paper.
    pitch_mm : Distance of neighbouring marks; side of one checker square.
    mark_mm : Diameter of a hole, or width of a line; unused for squares.
    reach_mm : Half-sides of the printed area around mark (0, 0); None has no end.
    dark : Dots are black, and all around them is white.
    squares : Columns and rows of a ChArUco board.
    """

    kind: ChartKind
    pitch_mm: float
    mark_mm: float = 0.0
    reach_mm: tuple[float, float] | None = None
    dark: bool = False
    squares: tuple[int, int] = (0, 0)

    def is_printed(
        self, chart_mm: Float[np.ndarray, "*points 2"]
    ) -> Bool[np.ndarray, "*points"]:
        """Whether chart positions lie in the printed area."""
        reach_mm = (np.inf, np.inf) if self.reach_mm is None else self.reach_mm
        return np.all(np.abs(chart_mm) <= np.array(reach_mm), axis=-1)


@dataclass(frozen=True)
class Pose:
    """Where the chart stands; angles in degrees, lengths in mm.

    Attributes
    ----------
    distance_mm : From the sensor to the chart's centre.
    tilt_deg, pan_deg, roll_deg : About x, y and z.
    shift_mm : Of the chart's centre, right and down.
    bow_mm_per_m2 : The bend: z rises by this times X^2 + Y^2 in square metres.
    """

    distance_mm: float
    tilt_deg: float = 0.0
    pan_deg: float = 0.0
    roll_deg: float = 0.0
    shift_mm: tuple[float, float] = (0.0, 0.0)
    bow_mm_per_m2: float = 0.0

    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """From chart axes to object space."""
        angles = np.radians([self.tilt_deg, self.pan_deg, self.roll_deg])
        (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
        about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        return about_z @ about_y @ about_x

    def placed(
        self, chart_mm: Float[np.ndarray, "points 2"]
    ) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
        """Object-space positions of chart points, and unit normals there."""
        bend = self.bow_mm_per_m2 * 1e-6
        x, y = chart_mm.T
        flat = np.stack([x, y, bend * (x * x + y * y)], -1)
        normal = np.stack([-2 * bend * x, -2 * bend * y, np.ones_like(x)], -1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        shift = np.array([*self.shift_mm, self.distance_mm])
        axes = self.rotation()
        # einsum, since a threaded matrix product wakes all cores for three columns.
        turned = np.einsum("ij,nj->ni", axes, flat)
        return turned + shift, np.einsum("ij,nj->ni", axes, normal)


def pattern_coverage(
    chart: Chart,
    chart_mm: Float[np.ndarray, "*points 2"],
    footprint_mm: Float[np.ndarray, "*points 2"],
) -> Float[np.ndarray, "*points"]:
    """Brightness of the pattern averaged over a small box, in [0, 1].

    Exact for a box with sides along the chart's axes, each of `footprint_mm`; dots are
    averaged across their edge only.
    """
    pattern = _endless_coverage(chart, chart_mm, footprint_mm)
    return pattern if chart.reach_mm is None else pattern * chart.is_printed(chart_mm)


def _endless_coverage(chart: Chart, chart_mm, footprint_mm):
    x, y = np.moveaxis(chart_mm, -1, 0)
    width_x, width_y = np.moveaxis(footprint_mm, -1, 0)
    if chart.kind == "checkerboard":
        sign_x = _square_wave(x / chart.pitch_mm, width_x / chart.pitch_mm)
        sign_y = _square_wave(y / chart.pitch_mm, width_y / chart.pitch_mm)
        return 0.5 + 0.5 * sign_x * sign_y
    if chart.kind == "charuco":
        return _board_coverage(chart, chart_mm, footprint_mm)
    if chart.kind == "line-grid":
        duty = chart.mark_mm / chart.pitch_mm
        dark_x = 1.0 - _pulse(x / chart.pitch_mm, width_x / chart.pitch_mm, duty)
        dark_y = 1.0 - _pulse(y / chart.pitch_mm, width_y / chart.pitch_mm, duty)
        return 1.0 - dark_x * dark_y
    near_x = x - chart.pitch_mm * np.round(x / chart.pitch_mm)
    near_y = y - chart.pitch_mm * np.round(y / chart.pitch_mm)
    inside_mm = chart.mark_mm / 2 - np.hypot(near_x, near_y)
    return np.clip(0.5 + inside_mm / np.sqrt(width_x * width_y), 0.0, 1.0)


def _board_coverage(chart: Chart, chart_mm, footprint_mm):
    """White where OpenCV's picture of the board is, and around it."""
    summed = _dark_summed(chart.squares)
    middle = SQUARE_PX * (chart_mm / chart.pitch_mm + np.array(chart.squares) // 2)
    half = SQUARE_PX * footprint_mm / chart.pitch_mm / 2
    sides = np.stack([middle - half, middle + half], -1).reshape(-1, 2, 2)
    dark = _dark_within(summed, sides.astype(float)).reshape(middle.shape[:-1])
    return 1 - dark / (2 * half).prod(-1)


@nb.njit(nogil=True, cache=True)
def _dark_within(
    summed: Float[np.ndarray, "rows columns"], sides: Float[np.ndarray, "boxes 2 2"]
) -> Float[np.ndarray, " boxes"]:
    """Dark area in boxes of a picture (left and right, top and bottom), from its sums,
    linear between pixels; as on its border beyond it."""
    last_row, last_column = summed.shape[0] - 1, summed.shape[1] - 1
    found = np.zeros(len(sides))
    for i in range(len(sides)):
        for k in range(4):
            x = min(max(sides[i, 0, k % 2], 0.0), float(last_column))
            y = min(max(sides[i, 1, k // 2], 0.0), float(last_row))
            column, row = min(int(x), last_column - 1), min(int(y), last_row - 1)
            u, v = x - column, y - row
            above = (1 - u) * summed[row, column] + u * summed[row, column + 1]
            below = (1 - u) * summed[row + 1, column] + u * summed[row + 1, column + 1]
            sign = 1.0 if k % 2 == k // 2 else -1.0
            found[i] += sign * ((1 - v) * above + v * below)
    return found


@cache
def _dark_summed(squares: tuple[int, int]) -> Float[np.ndarray, "rows columns"]:
    """Dark pixels of the board above and to the left, in a picture whose modules are
    whole numbers of pixels."""
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))
    board = cv2.aruco.CharucoBoard(squares, 1.0, MARKER_RATIO, markers)
    size = (SQUARE_PX * squares[0], SQUARE_PX * squares[1])
    picture = board.generateImage(size, marginSize=0)
    return cv2.integral((picture < 128).astype(np.uint8)).astype(float)


def _pulse(phase, width, duty: float):
    """Box mean of a train of pulses centred on the integers."""

    def integral(position):
        whole = np.floor(position + 0.5)
        part = np.clip(position - whole, -duty / 2, duty / 2)
        return whole * duty + part

    return (integral(phase + width / 2) - integral(phase - width / 2)) / width


def _square_wave(phase, width):
    """Box mean of a wave that is +1 on [0, 1), -1 on [1, 2), period 2."""

    def integral(position):
        within = position - 2.0 * np.floor(position * 0.5)
        return np.minimum(within, 2.0 - within)

    return (integral(phase + width / 2) - integral(phase - width / 2)) / width

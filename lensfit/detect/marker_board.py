"""The print of a ChArUco board: squares, and the markers in the bright ones.

Places are in squares from the board's first inner corner, right and down, as
`detect.corners` counts them. A marker stands in the middle of its square; it is a grid
of modules, the outermost of them black. The mean of the print over a box with sides
along the board follows from its summed area, which is bilinear within a module and so
exact between the modules' corners.

Reference: F. C. Crow, "Summed-area tables for texture mapping", SIGGRAPH 1984; the
markers are those of `cv2.aruco`.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import map_coordinates

_ABOUT = 2
"""Squares that stand about a corner, to each side."""


class MarkerBoard(NamedTuple):
    """The markers of a board.

    Attributes
    ----------
    dark : Modules of every square, rows first; None dark where a square has no marker.
    ratio : Side of a marker over that of its square.
    """

    dark: Bool[np.ndarray, "rows columns modules modules"]
    ratio: float

    def about(self, corner: Int[np.ndarray, "2"]) -> "MarkerBoard":
        """The squares around an inner corner; none have markers beyond the board. If
        the square ahead of it, right and down, is a dark one, they are mirrored, right
        for left, so that a bright one is."""
        column, row = corner + 1 + _ABOUT  # of the square ahead, in the wider board
        wide = np.pad(self.dark, [(_ABOUT, _ABOUT)] * 2 + [(0, 0)] * 2)
        around = wide[row - _ABOUT :, column - _ABOUT :][: 2 * _ABOUT, : 2 * _ABOUT]
        if not wide[row, column].any():
            around = around[:, ::-1, :, ::-1]
        return MarkerBoard(around, self.ratio)

    def is_bright_ahead(
        self, corners: Int[np.ndarray, "corners 2"]
    ) -> Bool[np.ndarray, " corners"]:
        """Whether the square right of and below inner corners has a marker."""
        column, row = corners.T + 1
        return np.any(self.dark[row, column], (-2, -1))

    @property
    def margin(self) -> float:
        """From the side of a square to its marker, in squares."""
        return (1 - self.ratio) / 2


def marker_board(pattern: cv2.aruco.CharucoBoard) -> MarkerBoard:
    """The markers of a board of OpenCV's, as it is printed."""
    columns, rows = pattern.getChessboardSize()
    side, ratio = pattern.getSquareLength(), pattern.getMarkerLength()
    dictionary = pattern.getDictionary()
    modules = dictionary.markerSize + 2
    dark = np.zeros((rows, columns, modules, modules), bool)
    for number, corners in zip(pattern.getIds(), pattern.getObjPoints(), strict=True):
        column, row, _ = np.floor(np.mean(np.asarray(corners), 0) / side).astype(int)
        marker = cv2.aruco.generateImageMarker(dictionary, int(number), modules)
        dark[row, column] = marker < 128
    return MarkerBoard(dark, ratio / side)


def dark_share(
    dark: Bool[np.ndarray, "rows columns modules modules"],
    ratio: float,
    places: Float[np.ndarray, "*shape 2"],
    box: Float[np.ndarray, "*#shape 2"],
) -> Float[np.ndarray, "*shape"]:
    """Part of boxes that dark modules cover; none beyond the board.

    Parameters
    ----------
    dark : Modules of every square.
    places : Middle of each box, right and down from the outer corner of the first
        square, in squares.
    box : Its sides.
    """
    rows, columns, modules = dark.shape[:3]
    across, down = _nodes(columns, modules, ratio), _nodes(rows, modules, ratio)
    printed = np.pad(dark, [(0, 0), (0, 0), (1, 1), (1, 1)])
    printed = printed.transpose(0, 2, 1, 3).reshape(len(down) - 1, len(across) - 1)
    area = np.diff(down)[:, None] * np.diff(across) * printed
    summed = np.pad(area.cumsum(0).cumsum(1), [(1, 0), (1, 0)])
    low, high = places - box / 2, places + box / 2
    at_x = [
        np.interp(end[..., 0], across, np.arange(len(across))) for end in (low, high)
    ]
    at_y = [np.interp(end[..., 1], down, np.arange(len(down))) for end in (low, high)]

    def until(y: np.ndarray, x: np.ndarray) -> np.ndarray:
        return map_coordinates(summed, [y, x], order=1, mode="nearest")

    inside = until(at_y[1], at_x[1]) - until(at_y[0], at_x[1])
    inside -= until(at_y[1], at_x[0]) - until(at_y[0], at_x[0])
    return inside / box.prod(-1)


def _nodes(squares: int, modules: int, ratio: float) -> Float[np.ndarray, " nodes"]:
    """Edges of the margins and modules of some squares in a row."""
    within = (1 - ratio) / 2 + ratio * np.arange(modules + 1) / modules
    each = np.arange(squares)[:, None] + np.concatenate([[0.0], within])
    return np.append(each.ravel(), squares)

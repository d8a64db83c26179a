"""Tiles in which a frame is blurred, and which of them light of a level can reach."""

from typing import NamedTuple

import cv2
import numpy as np

from lensfit.coords import Window
from lensfit.render.blur_setup import BlurSetup

CELL = 16
"""Side of the cells, pixels, by which is told where a level has anything."""


class BlurTiles(NamedTuple):
    """Square tiles of one size; a margin of their arrays continues the border.

    Attributes
    ----------
    size : Of a side, pixels.
    margin : That the arrays have around the window, for the widest kernel.
    rows, columns : Of tiles.
    height, width : Of the output window.
    top, left : Of the output window within the window.
    padding : Of the arrays, before and behind, down and across.
    """

    size: int
    margin: int
    rows: int
    columns: int
    height: int
    width: int
    top: int
    left: int
    padding: tuple[tuple[int, int], tuple[int, int]]

    @classmethod
    def over(cls, window: Window, output: Window, setup: BlurSetup) -> "BlurTiles":
        """Tiles over `output`, which lies inside `window`."""
        size = setup.tile
        margin = (max(setup.rooms.values(), default=size) - size) // 2
        rows, columns = -(-output.height // size), -(-output.width // size)
        top, left = output.y_min - window.y_min, output.x_min - window.x_min
        below = max(top + rows * size - window.height, 0)
        right = max(left + columns * size - window.width, 0)
        padding = ((margin, margin + below), (margin, margin + right))
        return cls(
            size, margin, rows, columns, output.height, output.width, top, left, padding
        )

    def corner(self, tile: int, room: int) -> tuple[int, int]:
        """Row and column, in padded arrays, of a tile's surroundings."""
        row, column = divmod(tile, self.columns)
        spare = self.margin - (room - self.size) // 2
        return (
            self.top + row * self.size + spare,
            self.left + column * self.size + spare,
        )

    def inside(self, tile: int) -> tuple[slice, slice]:
        """The tile in the output."""
        row, column = divmod(tile, self.columns)
        y, x = row * self.size, column * self.size
        return (
            slice(y, min(y + self.size, self.height)),
            slice(x, min(x + self.size, self.width)),
        )

    def reached(self, cells: np.ndarray, reach_px: int) -> list[int]:
        """Tiles that light from these cells of the window can reach."""
        wide = 2 * -(-reach_px // CELL) + 1
        lit = cv2.dilate(cells, np.ones((wide, wide), np.uint8))
        found = []
        for tile in range(self.rows * self.columns):
            row, column = divmod(tile, self.columns)
            y, x = self.top + row * self.size, self.left + column * self.size
            y1, x1 = y + self.size, x + self.size
            if lit[y // CELL : -(-y1 // CELL), x // CELL : -(-x1 // CELL)].any():
                found.append(tile)
        return found

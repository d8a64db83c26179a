"""Kernels and tiles with which a range of depth is blurred over one window."""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Complex64, Float, Float32, Int

from lensfit.render.field_grid import FieldGrid


@dataclass(eq=False)
class BlurSetup:
    """Kernels and tiles for one range of depth over one window.

    Attributes
    ----------
    levels : That occur, far to near.
    grid : Nodes of the kernels.
    chromatic : Whether each channel has kernels of its own.
    transforms : Of the kernels of each level that is blurred.
    rooms : Side of the transformed tiles of each such level; sharp ones have none.
    tile : Side of the tiles that are filled.
    reaches : Half the size of each level's kernel; estimated by a probe.
    light_step_px : As in `BlurBudget`.
    is_mixed : Whether kernels were mixed from those of a few depths.
    """

    levels: list[int]
    grid: FieldGrid
    chromatic: bool
    transforms: dict[int, Complex64[jax.Array, "nodes channels room half"]]
    rooms: dict[int, int]
    tile: int
    reaches: dict[int, int]
    light_step_px: float
    is_mixed: bool

    @property
    def is_sharp(self) -> bool:
        """Whether nothing is blurred visibly."""
        return not self.rooms

    def reach_px(self, level: int) -> int:
        """How far light of a level travels."""
        return self.reaches[level] if level in self.rooms else 0

    def around(
        self, corners: Int[np.ndarray, "tiles 2"], room: int
    ) -> tuple[Int[np.ndarray, "tiles corners"], Float32[np.ndarray, "tiles 4"]]:
        """The nodes around tiles, and their cells counted from the tiles' corners.

        Parameters
        ----------
        corners : Row and column of the tiles' first pixels in the window.
        """
        grid = self.grid
        if not grid.varies:
            count = len(corners)
            return np.zeros((count, 1), np.int32), np.zeros((count, 4), np.float32)
        width, height = grid.cell_px
        middle = corners + room / 2
        column = np.clip(middle[:, 1] // width, 0, grid.columns - 1).astype(np.int32)
        row = np.clip(middle[:, 0] // height, 0, grid.rows - 1).astype(np.int32)
        first = row * (grid.columns + 1) + column
        below = first + grid.columns + 1
        nodes = np.stack([first, first + 1, below, below + 1], -1)
        left, top = column * width - corners[:, 1], row * height - corners[:, 0]
        size = np.broadcast_to([[width, height]], (len(corners), 2))
        cells = np.concatenate([np.stack([left, top], -1), size], -1)
        return nodes, cells.astype(np.float32)

    def place_of_light(
        self, centre_px: Float[np.ndarray, "2"]
    ) -> Float[np.ndarray, "2"]:
        """Where a light's kernel is taken, x and y in the pixel space of the plate.

        A kernel serves lights within an eighth of a cell, so that neighbours share it.
        """
        window = self.grid.window
        if not self.grid.varies:
            return self.grid.nodes_px()[0]
        step = np.array(self.grid.cell_px) / 4
        rounded = (np.floor(centre_px / step) + 0.5) * step
        return rounded + np.array(window[:2])

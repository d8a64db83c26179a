"""Places of a frame where kernels are made; between them they are mixed bilinearly."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensfit.coords import Window


@dataclass(frozen=True)
class FieldGrid:
    """Nodes over a window: `columns` by `rows` cells, one more node than cells.

    No cells: one kernel for the whole window, that of its centre.
    """

    window: Window
    columns: int
    rows: int

    @property
    def varies(self) -> bool:
        """Whether kernels differ from place to place of the frame."""
        return self.columns > 0

    @property
    def cell_px(self) -> tuple[float, float]:
        """Width and height of a cell."""
        return (
            self.window.width / max(self.columns, 1),
            self.window.height / max(self.rows, 1),
        )

    def nodes_px(self) -> Float[np.ndarray, "nodes 2"]:
        """Positions, row by row."""
        w = self.window
        if not self.varies:
            return np.array([[w.x_min + w.width / 2, w.y_min + w.height / 2]])
        x = np.linspace(w.x_min, w.x_max + 1, self.columns + 1)
        y = np.linspace(w.y_min, w.y_max + 1, self.rows + 1)
        return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)

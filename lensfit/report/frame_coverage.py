"""Coverage of the frame by points, and the residuals there.

The frame is divided into cells; in a cell without any point the map is extrapolated.
Counts come from the residual lists of the report, which may be thinned to a few
thousand points per take: empty cells stay empty under thinning, totals change.
Pixels as everywhere in lensfit: (0, 0) is the outer corner of the top left pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Float, Int

COLUMNS = 8
ROWS = 6
_ACROSS = ("left", "", "right")
_DOWN = ("top", "", "bottom")


@final
@dataclass(frozen=True)
class Residuals:
    """Points of one or several takes: where they were, observed minus predicted.

    Attributes
    ----------
    points_px : positions in the image, pixels.
    errors_px : observed minus predicted position, pixels.
    """

    points_px: Float[np.ndarray, "points 2"]
    errors_px: Float[np.ndarray, "points 2"]


def numbers(values: Any) -> Float[np.ndarray, "..."]:
    """An array of floats from a JSON list, with NaN where it says null."""
    return np.asarray([] if values is None else values, dtype=np.float64)


def residuals_of(takes: Sequence[dict]) -> Residuals:
    """The residuals of several takes in one, without those that are not finite."""
    blocks = [np.zeros((0, 4))]
    for take in takes:
        lists = take.get("residuals") or {}
        columns = [numbers(lists.get(k)) for k in ("x_px", "y_px", "dx_px", "dy_px")]
        if len({column.size for column in columns}) == 1:
            blocks.append(np.stack(columns, axis=1))
    table = np.concatenate(blocks)
    table = table[np.isfinite(table).all(axis=1)]
    return Residuals(table[:, :2], table[:, 2:])


def image_size_px(report: dict) -> tuple[float, float]:
    """Width and height of the frame, pixels; (0, 0) if not stated."""
    camera = report.get("camera") or {}
    width, height = camera.get("image_width_px"), camera.get("image_height_px")
    return (float(width), float(height)) if width and height else (0.0, 0.0)


def cell_of(
    points_px: Float[np.ndarray, "points 2"],
    size_px: tuple[float, float],
    columns: int = COLUMNS,
    rows: int = ROWS,
) -> tuple[Int[np.ndarray, " points"], Int[np.ndarray, " points"]]:
    """Row and column of the cell that each point lies in, clipped to the frame."""
    column = np.floor(points_px[:, 0] / size_px[0] * columns).astype(np.int64)
    row = np.floor(points_px[:, 1] / size_px[1] * rows).astype(np.int64)
    return np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)


def cell_counts(
    points_px: Float[np.ndarray, "points 2"],
    size_px: tuple[float, float],
    columns: int = COLUMNS,
    rows: int = ROWS,
) -> Int[np.ndarray, "rows columns"]:
    """Number of points in each cell of the frame, row 0 on top."""
    counts = np.zeros((rows, columns), dtype=np.int64)
    np.add.at(counts, cell_of(points_px, size_px, columns, rows), 1)
    return counts


def empty_places(counts: Int[np.ndarray, "rows columns"]) -> list[str]:
    """Names of the ninths of the frame ("top left", "centre") that hold empty cells.

    A ninth is named when a third or more of its cells have no point.
    """
    rows, columns = counts.shape
    down = np.arange(rows) * 3 // rows
    across = np.arange(columns) * 3 // columns
    places = []
    for i in range(3):
        for j in range(3):
            ninth = counts[np.ix_(down == i, across == j)]
            if ninth.size and np.mean(ninth == 0) > 0.33:
                places.append(f"{_DOWN[i]} {_ACROSS[j]}".strip() or "centre")
    return places


def pattern_px(
    residuals: Residuals, size_px: tuple[float, float], columns: int = COLUMNS
) -> float:
    """Rms of the part of the residuals that is the same for neighbouring points.

    The mean error of a cell holds the map's own error and noise / sqrt(count); the
    second is subtracted, so pure noise gives about zero. NaN without enough points.
    """
    rows = max(1, columns * ROWS // COLUMNS)
    counts = cell_counts(residuals.points_px, size_px, columns, rows)
    full = counts >= 4
    if not full.any():
        return float("nan")
    means, noise = cell_means(residuals, size_px, columns, rows)
    power = np.sum(means**2, axis=-1)[full] - noise[full] / counts[full]
    return float(np.sqrt(max(0.0, np.average(power, weights=counts[full]))))


def cell_means(
    residuals: Residuals, size_px: tuple[float, float], columns: int, rows: int
) -> tuple[Float[np.ndarray, "rows columns 2"], Float[np.ndarray, "rows columns"]]:
    """Mean error of each cell (px), and the variance about it summed over x and y."""
    place = cell_of(residuals.points_px, size_px, columns, rows)
    counts = np.maximum(cell_counts(residuals.points_px, size_px, columns, rows), 1)
    sums = np.zeros((rows, columns, 2))
    np.add.at(sums, place, residuals.errors_px)
    means = sums / counts[..., None]
    squares = np.zeros((rows, columns))
    np.add.at(squares, place, np.sum((residuals.errors_px - means[place]) ** 2, -1))
    return means, squares / np.maximum(counts - 1, 1)

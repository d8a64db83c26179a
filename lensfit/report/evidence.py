"""The evidence of the verdict: findings, takes, errors and coverage of a report.

The frame is divided into cells; in a cell without any point the map is extrapolated.
Counts come from the residual lists of the report, which may be thinned to a few
thousand points per take: empty cells stay empty under thinning, totals change.
Pixels as everywhere in lensfit: (0, 0) is the outer corner of the top left pixel.

A report may be old or partial: what is absent is NaN, or nothing.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, final

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


PRECISE_PX, GOOD_PX, ROUGH_PX = 0.1, 0.5, 1.5
"""What is negligible for set measurement; where a locked-off match-move begins to show;
where soft CG does."""
LEAST_OBJECT_DEVIATION_PX = 3 * PRECISE_PX
"""Standard deviation of objects, both axes together, above which they bear on what a
lens is good for. Of errors with this deviation a tenth are negligible, 1 - exp(-1/9):
of smaller ones too many lenses would be called worse than they are."""

CORNER_SIGNS = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
"""Top left, top right, bottom left, bottom right, of x right and y down."""
Tone = Literal["good", "note", "caution", "bad"]


@final
@dataclass(frozen=True)
class Finding:
    """One sentence of the verdict and how much it should worry the reader.

    Attributes
    ----------
    kind : One word for programs; that of the rule that found it where it is empty.
    remedy : The one thing to do, where the sentence does not end with it.
    """

    tone: Tone
    sentence: str
    kind: str = ""
    remedy: str = ""


def used_takes(report: dict) -> list[dict]:
    """The takes that went into the fit."""
    return [take for take in report.get("takes") or [] if not take.get("failed")]


def takes_by_focal(report: dict) -> dict[float | None, list[dict]]:
    """Used takes gathered by focal length, shortest first, unstated (None) last."""
    groups: dict[float | None, list[dict]] = {}
    for take in used_takes(report):
        groups.setdefault(take.get("focal_length_mm"), []).append(take)
    return dict(sorted(groups.items(), key=lambda one: (one[0] is None, one[0] or 0.0)))


def unmeasured_focals(report: dict) -> list[float | None]:
    """Stated focal lengths (mm) that no view measured, None where the report is old."""
    measured_by_focal: dict[float | None, bool] = {}
    for term in report.get("terms") or []:
        if "principal_distance" in str(term.get("name")):
            focal = term.get("focal_length_mm")
            measured_by_focal[focal] = measured_by_focal.get(focal, False) or bool(
                term.get("kept")
            )
    return [focal for focal, measured in measured_by_focal.items() if not measured]


def corner_deviation_px(entry: dict) -> float:
    """Largest standard deviation (px) at the corners of an entry's grid, or NaN."""
    return float(np.max(_corners_px(entry, "uncertainty_grid")))


def extrapolated_corner_px(report: dict, entry: dict) -> float:
    """Largest standard deviation (px) at corners that no point is near, or NaN."""
    every = _corners_px(entry, "uncertainty_grid")
    corners = every[~corners_photographed(report, entry)]
    known = corners[np.isfinite(corners)]
    return float(known.max()) if known.size else math.nan


def photographed_corner_px(report: dict, entry: dict) -> float:
    """Standard deviation (px) of the map in the worst corner with points near it, or
    NaN.

    As far into each corner as points reach: from the last of them to the very corner
    the map is extrapolated, where its deviation grows several times over.
    """
    of_map = _deviations_in_photographed_corners(report, entry, "uncertainty_grid")
    return float(of_map.max()) if of_map.size else math.nan


def object_deviation_px(report: dict, entry: dict) -> float:
    """Standard deviation (px) of where objects in focus land, rms over the corners with
    points near them, or NaN.

    With the camera where it is: what a turn of the camera would make good of the map is
    an error of the picture all the same.
    """
    of_objects = _deviations_in_photographed_corners(
        report, entry, "object_uncertainty_grid"
    )
    return float(np.sqrt(np.mean(of_objects**2))) if of_objects.size else math.nan


def _deviations_in_photographed_corners(
    report: dict, entry: dict, key: str
) -> np.ndarray:
    """The known deviations of a grid in the corners that were photographed."""
    photographed = corners_photographed(report, entry)
    reached = _corners_reached(report, entry)
    grid = entry.get(key) or {}
    x_mm, y_mm, sd_px = (numbers(grid.get(k)) for k in ("x_mm", "y_mm", "sd_px"))
    if reached is None or sd_px.shape != (y_mm.size, x_mm.size) or sd_px.size < 4:
        found = _corners_px(entry, key)[photographed]
    else:
        at = reached[photographed]
        found = np.array([_interpolated_value(x_mm, y_mm, sd_px, one) for one in at])
    return found[np.isfinite(found)]


def _corners_reached(report: dict, entry: dict) -> np.ndarray | None:
    """How far points of the focal length reach into each corner, along x and along y,
    mm from the sensor's centre (4, 2); None where the report does not state it."""
    camera, size = report.get("camera") or {}, image_size_px(report)
    sides = camera.get("sensor_width_mm"), camera.get("sensor_height_mm")
    takes = takes_by_focal(report).get(entry.get("focal_length_mm")) or []
    points = residuals_of(takes).points_px
    if not all(size) or None in sides or not len(points):
        return None
    place = (points / size - 0.5) * np.array(sides, float)
    reached = []
    for sign in CORNER_SIGNS:
        mine = (place * sign > 0).all(axis=1)
        reached.append(sign * (place[mine] * sign).max(axis=0, initial=0.0))
    return np.array(reached)


def _interpolated_value(
    x_mm: np.ndarray, y_mm: np.ndarray, values: np.ndarray, at_mm: np.ndarray
) -> float:
    """Bilinear, on a grid whose nodes are ascending."""
    along = np.array([np.interp(at_mm[0], x_mm, row) for row in values])
    return float(np.interp(at_mm[1], y_mm, along))


def corners_photographed(report: dict, entry: dict) -> np.ndarray:
    """Whether any point of the focal length is in the two by two cells at each corner:
    top left, top right, bottom left, bottom right."""
    focal = entry.get("focal_length_mm")
    for one, counts in counts_by_focal(report):
        if one == focal:
            halves = (slice(None, 2), slice(-2, None))
            ends = [counts[row, column].any() for row in halves for column in halves]
            return np.array(ends)
    return np.ones(4, bool)


def _corners_px(entry: dict, key: str) -> np.ndarray:
    """Standard deviations at the corners of a grid: top left and right, bottom left and
    right; NaN where there is no grid."""
    grid = numbers((entry.get(key) or {}).get("sd_px"))
    if grid.ndim != 2 or not grid.size:
        return np.full(4, math.nan)
    return grid[[0, 0, -1, -1], [0, -1, 0, -1]]


def value_of(number_or_none: Any) -> float:
    """A number, or NaN for None."""
    return math.nan if number_or_none is None else float(number_or_none)


def plural(count: int, noun: str) -> str:
    """A count with its noun."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def sentence_list(names: list[str]) -> str:
    """Names as a list in a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def error_px(report: dict) -> tuple[float, str]:
    """The error that judges the whole, and whose it is."""
    held_out = value_of(report.get("held_out_rms_px"))
    if not math.isnan(held_out):
        return held_out, "points that the fit never saw"
    return value_of(report.get("rms_px")), "the fitted points (none were held out)"


def counts_by_focal(report: dict) -> Iterator[tuple[float | None, np.ndarray]]:
    """Points in every cell of the frame, for each focal length that has any."""
    size = image_size_px(report)
    for focal, takes in takes_by_focal(report).items():
        points = residuals_of(takes).points_px
        if len(points) and all(size):
            yield focal, cell_counts(points, size)


def covered_share(counts: np.ndarray) -> float:
    """Part of the cells that any point is in."""
    return float(np.mean(counts > 0))

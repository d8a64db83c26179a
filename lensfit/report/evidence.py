"""The evidence of the verdict: findings, takes, errors and coverage of a report.

A report may be old or partial: what is absent is NaN, or nothing.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np

from lensfit.report.frame_coverage import (
    cell_counts,
    image_size_px,
    numbers,
    residuals_of,
)

PRECISE_PX, GOOD_PX, ROUGH_PX = 0.1, 0.5, 1.5
"""What is negligible for set measurement; where a locked-off match-move begins to show;
where soft CG does."""
LEAST_OBJECT_DEVIATION_PX = 3 * PRECISE_PX
"""Standard deviation of objects above which they bear on what a lens is good for. Of
errors with this deviation a quarter are negligible, erf(1 / (3 sqrt 2)): of smaller
ones too many lenses would be called worse than they are."""

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
    of_map = _in_photographed_corners(report, entry, "uncertainty_grid")
    return float(of_map.max()) if of_map.size else math.nan


def object_deviation_px(report: dict, entry: dict) -> float:
    """Standard deviation (px) of where objects in focus land, rms over the corners with
    points near them, or NaN.

    With the camera where it is: what a turn of the camera would make good of the map is
    an error of the picture all the same.
    """
    of_objects = _in_photographed_corners(report, entry, "object_uncertainty_grid")
    return float(np.sqrt(np.mean(of_objects**2))) if of_objects.size else math.nan


def _in_photographed_corners(report: dict, entry: dict, key: str) -> np.ndarray:
    """The known deviations of a grid in the corners that were photographed."""
    photographed = corners_photographed(report, entry)
    reached = _corners_reached(report, entry)
    grid = entry.get(key) or {}
    x_mm, y_mm, sd_px = (numbers(grid.get(k)) for k in ("x_mm", "y_mm", "sd_px"))
    if reached is None or sd_px.shape != (y_mm.size, x_mm.size) or sd_px.size < 4:
        found = _corners_px(entry, key)[photographed]
    else:
        at = reached[photographed]
        found = np.array([_interpolated(x_mm, y_mm, sd_px, one) for one in at])
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


def _interpolated(
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


def joined(names: list[str]) -> str:
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

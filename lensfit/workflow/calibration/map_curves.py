"""Distortion over the frame as curves and grids, with standard deviations.

Everything is plain numbers, ready for JSON; `lensfit.report` draws them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from lensfit.batches import in_batches
from lensfit.errors import LensfitError
from lensfit.lens import Lens
from lensfit.optics.position_deviation import FRAME_GRID
from lensfit.report.plain_numbers import rounded

RADII = 40
Deviation = Callable[[Float[np.ndarray, "points 2"]], Float[np.ndarray, " points"]]
"""Standard deviation, mm, of where points of the undistorted picture land."""
_SPOKES = 24


def points_over_frame(
    size_mm: tuple[float, float], margin: float = 0.0
) -> Float[np.ndarray, "points 2"]:
    """A grid of points over the frame, and so much of it beyond, row by row."""
    return np.stack(np.meshgrid(*_axes(size_mm, margin)), -1).reshape(-1, 2)


def _axes(size_mm, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    half = np.asarray(size_mm) / 2 * (1 + margin)
    return np.linspace(-half[0], half[0], FRAME_GRID[0]), np.linspace(
        -half[1], half[1], FRAME_GRID[1]
    )


def distortion_grid(lens: Lens, size_mm: tuple[float, float]) -> dict[str, Any]:
    """How far the points of a straight grid move."""
    x, y = _axes(size_mm)
    points = points_over_frame(size_mm)
    moved = in_batches(lens.distorted_from_undistorted, points) - points
    shape = (len(y), len(x))
    return {
        "x_mm": rounded(x, 4),
        "y_mm": rounded(y, 4),
        "dx_mm": [rounded(row, 5) for row in moved[:, 0].reshape(shape)],
        "dy_mm": [rounded(row, 5) for row in moved[:, 1].reshape(shape)],
    }


def radial_profile(
    lens: Lens, size_mm: tuple[float, float], deviation: Deviation | None
) -> dict[str, Any]:
    """Mean over azimuth of the relative change of radius.

    Parameters
    ----------
    deviation : None if unknown.
    """
    centre = np.asarray(lens.distortion.principal_point_mm)
    radius = np.linspace(0, np.hypot(*size_mm) / 2, RADII)[1:]
    angle = 2 * np.pi * np.arange(_SPOKES) / _SPOKES
    spokes = np.stack([np.cos(angle), np.sin(angle)], -1)
    points = (radius[:, None, None] * spokes[None]).reshape(-1, 2) + centre
    moved = in_batches(lens.distorted_from_undistorted, points) - centre
    ratio = np.hypot(*moved.T).reshape(len(radius), -1).mean(1) / radius
    profile: dict[str, Any] = {
        "radius_mm": rounded(radius, 4),
        "distortion_percent": rounded(100 * (ratio - 1), 5),
    }
    if deviation is not None:
        squares = deviation(points).reshape(len(radius), -1) ** 2
        spread = np.sqrt(np.mean(squares, 1)) / radius
        profile["standard_deviation_percent"] = rounded(100 * spread, 6)
    return profile


def uncertainty_grid(
    lens: Lens,
    size_px: tuple[int, int],
    size_mm: tuple[float, float],
    deviation: Deviation,
) -> dict[str, Any]:
    """Standard deviation of the distorted position at points of the photograph."""
    seen = points_over_frame(size_mm)
    points = in_batches(lens.undistorted_from_distorted, seen)
    finite = np.isfinite(points).all(-1)
    deviations = np.full(len(points), np.nan)
    deviations[finite] = deviation(points[finite])
    x, y = _axes(size_mm)
    rows = (deviations / (size_mm[0] / size_px[0])).reshape(len(y), len(x))
    return {
        "x_mm": rounded(x, 4),
        "y_mm": rounded(y, 4),
        "sd_px": [rounded(row, 5) for row in rows],
    }


def object_uncertainty_grid(
    lens: Lens,
    size_px: tuple[int, int],
    size_mm: tuple[float, float],
    distance_mm: float,
) -> dict[str, Any] | None:
    """Standard deviation of where objects of one distance land, at the same points.

    `uncertainty_grid` leaves out what a turn of the camera would do as well. A camera
    that was placed by other means does not turn: here only the shift and scale of the
    objects' plane are left out. None where the lens does not say.

    Parameters
    ----------
    distance_mm : Of the objects from the sensor.
    """
    centre_mm = np.asarray(lens.distortion.principal_point_mm)
    ahead_mm = distance_mm - float(lens.entrance_pupil_offset_mm)

    def deviation(points: Float[np.ndarray, "points 2"]) -> np.ndarray:
        slope = (points - centre_mm) / float(lens.distortion.principal_distance_mm)
        objects = np.column_stack([slope * ahead_mm, np.full(len(slope), distance_mm)])
        return np.hypot(*lens.object_standard_deviation_mm(objects).T)

    try:
        return uncertainty_grid(lens, size_px, size_mm, deviation)
    except LensfitError:
        return None

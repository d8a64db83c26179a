"""Figures of a fitted state for the report: curves and grids over the frame.

Everything is plain numbers, ready for JSON; `lensfit.report` draws them.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from lensfit.batches import in_batches
from lensfit.coords import Window
from lensfit.errors import LensfitError
from lensfit.fitting.chart_view import View
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.uncertainty import position_deviation_mm, position_variances_mm2
from lensfit.lens import Lens
from lensfit.optics.falloff import log_loss
from lensfit.optics.map_deviations import FRAME_GRID
from lensfit.preset.blocks import Camera
from lensfit.rendering.overscan import cg_camera, margins_read
from lensfit.report.plain_numbers import plain_distance, rounded_numbers

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
        "x_mm": rounded_numbers(x, 4),
        "y_mm": rounded_numbers(y, 4),
        "dx_mm": [rounded_numbers(row, 5) for row in moved[:, 0].reshape(shape)],
        "dy_mm": [rounded_numbers(row, 5) for row in moved[:, 1].reshape(shape)],
    }


def position_deviation_of(lens: Lens) -> Deviation | None:
    """At any points of the undistorted picture, what a pose would undo over the frame
    left out; None if the lens does not say."""
    if lens.covariances.distortion is None:
        return None
    return lambda points: np.hypot(*lens.position_standard_deviation_mm(points).T)


def radial_profile(
    lens: Lens, size_mm: tuple[float, float], deviation: Deviation | None
) -> dict[str, Any]:
    """Mean over azimuth of the relative change of radius.

    Parameters
    ----------
    deviation : None if unknown. The circles reach beyond the frame.
    """
    centre = np.asarray(lens.distortion.principal_point_mm)
    radius = np.linspace(0, np.hypot(*size_mm) / 2, RADII)[1:]
    angle = 2 * np.pi * np.arange(_SPOKES) / _SPOKES
    spokes = np.stack([np.cos(angle), np.sin(angle)], -1)
    points = (radius[:, None, None] * spokes[None]).reshape(-1, 2) + centre
    moved = in_batches(lens.distorted_from_undistorted, points) - centre
    ratio = np.hypot(*moved.T).reshape(len(radius), -1).mean(1) / radius
    profile: dict[str, Any] = {
        "radius_mm": rounded_numbers(radius, 4),
        "distortion_percent": rounded_numbers(100 * (ratio - 1), 5),
    }
    if deviation is not None:
        squares = deviation(points).reshape(len(radius), -1) ** 2
        spread = np.sqrt(np.mean(squares, 1)) / radius
        profile["standard_deviation_percent"] = rounded_numbers(100 * spread, 6)
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
        "x_mm": rounded_numbers(x, 4),
        "y_mm": rounded_numbers(y, 4),
        "sd_px": [rounded_numbers(row, 5) for row in rows],
    }


def corner_shares(
    state: LensState, lens: Lens, size_mm: tuple[float, float]
) -> dict[str, float]:
    """Which share of the variance in the map's worst corner each kind of error has
    (`fitting.uncertainty.Uncertainty.parts`); none where no corner is known."""
    seen = points_over_frame(size_mm)
    points = in_batches(lens.undistorted_from_distorted, seen)
    known = np.isfinite(points).all(-1)
    at_rim = np.isclose(np.abs(seen), np.divide(size_mm, 2))
    corner = np.all(at_rim, axis=-1)[known]
    if not corner.any():
        return {}
    found = position_variances_mm2(
        state.geometry.adjustment, state.uncertainty, points[known]
    )
    of_corners = {name: variance[corner] for name, variance in found.items()}
    total = np.sum(list(of_corners.values()), 0)
    worst = int(np.argmax(total))
    return {
        name: round(float(variance[worst] / total[worst]), 4)
        for name, variance in of_corners.items()
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


def entry_facts(state: LensState, lens: Lens, camera: Camera) -> dict[str, Any]:
    """Curves and grids of one state, for the figures of the report."""
    d = state.distortion
    size_px = (camera.image_width_px, camera.image_height_px)
    size_mm = (camera.sensor_width_mm, camera.sensor_height_mm)
    centre = np.asarray(d.principal_point_mm)
    trip, monotone = _round_trip(lens, size_mm, size_mm[0] / size_px[0])
    display = Window.of_size(*size_px)
    needed = cg_camera(margins_read(lens, display), display, size_mm[0])
    deviation = partial(
        position_deviation_mm, state.geometry.adjustment, state.uncertainty
    )
    return {
        "focal_length_mm": state.focal_length_mm,
        "focus_distance_mm": plain_distance(state.focus_distance_mm),
        "principal_distance_mm": float(d.principal_distance_mm),
        "principal_point_mm": centre.tolist(),
        "distortion_centre_mm": centre.tolist(),
        "distortion_grid": distortion_grid(lens, size_mm),
        "radial_profile": radial_profile(lens, size_mm, position_deviation_of(lens)),
        "lateral_colour": _lateral_curves(state, size_px),
        "fall_off": [
            _fall_off_curves(f)
            | {"lighting_too": is_of_lighting_too(state.geometry.takes, f.f_number)}
            for f in state.fall_off
        ],
        "uncertainty_grid": uncertainty_grid(lens, size_px, size_mm, deviation),
        "corner_shares": corner_shares(state, lens, size_mm),
        "object_uncertainty_grid": object_uncertainty_grid(
            lens, size_px, size_mm, _object_distance_mm(state)
        ),
        "monotone": monotone,
        "round_trip_max_px": trip,
        "overscan_percent": needed.percent,
    }


def _object_distance_mm(state: LensState) -> float:
    """Where CG stands: in focus; at the chart where the focus is infinite or unknown,
    or so near that it was stated wrongly."""
    focus_mm = state.focus_distance_mm
    chart_mm = float(state.geometry.adjustment.frame.board_distance_mm)
    chart_mm += state.pupil.offset_mm
    if focus_mm is None or not np.isfinite(focus_mm):
        return chart_mm
    return focus_mm if focus_mm > 2 * state.pupil.offset_mm else chart_mm


def is_of_lighting_too(takes: Iterable[View], f_number: float | None) -> bool:
    """Whether a chart lit from its front was among those that gave a fall-off.

    The bright field around dark dots shows the light that fell on the chart as well.
    """
    shown = [take.observations for take in takes if take.f_number == f_number]
    return any(not seen.bright for seen in shown)


def _round_trip(lens: Lens, size_mm, mm_per_px: float) -> tuple[float, bool]:
    """Largest error of undistort then redistort over frame + 15 %, and no fold."""
    points = points_over_frame(size_mm, 0.15)
    straight = in_batches(lens.undistorted_from_distorted, points)
    back = in_batches(lens.distorted_from_undistorted, straight)
    error = np.linalg.norm(back - points, axis=-1)
    step = 1e-4 * size_mm[0]
    along = [
        in_batches(lens.distorted_from_undistorted, points + step * e)
        - in_batches(lens.distorted_from_undistorted, points - step * e)
        for e in np.eye(2)
    ]
    determinant = along[0][:, 0] * along[1][:, 1] - along[0][:, 1] * along[1][:, 0]
    return float(np.nanmax(error) / mm_per_px), bool(np.nanmin(determinant) > 0)


def _lateral_curves(state: LensState, size_px) -> dict[str, Any] | None:
    if not state.colour:
        return None
    reference = float(state.distortion.reference_radius_mm)
    scale = reference / float(state.geometry.adjustment.stack.mm_per_px[0])
    limit = max(c.valid_radius for c in state.colour.values())
    radius = np.linspace(0, limit, RADII)
    curves: dict[str, Any] = {"radius_mm": rounded_numbers(radius * reference, 4)}
    for name, colour in state.colour.items():
        value, deviation = colour.radial_px(radius, scale)
        curves[f"{name}_px"] = rounded_numbers(value, 5)
        curves[f"{name}_sd_px"] = rounded_numbers(deviation, 5)
    return curves


_log_losses = jax.jit(jax.vmap(log_loss, (0, None)))


def _fall_off_curves(fall_off) -> dict[str, Any]:
    s = np.linspace(0.0, 1.0, RADII) ** 2
    curves: dict[str, Any] = {
        "f_number": fall_off.f_number,
        "radius_mm": rounded_numbers(np.sqrt(s) * fall_off.valid_radius_mm, 4),
    }
    for name, control in zip("rgb", fall_off.control, strict=True):
        loss = np.asarray(_log_losses(s, control))
        curves[name] = rounded_numbers(np.exp(-loss), 5)
    deviation = fall_off.deviation(np.sqrt(s) * fall_off.valid_radius_mm)
    curves["sd"] = rounded_numbers(deviation.max(0), 6)
    return curves

"""Figures of a fitted state for the report: curves and grids over the frame.

Everything is plain numbers, ready for JSON; `lensfit.workflow.report` draws them.
"""

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np

from lensfit.batches import in_batches
from lensfit.coords import Window
from lensfit.fit.lens_state import LensState
from lensfit.fit.take import Take
from lensfit.fit.uncertainty import position_deviation_mm
from lensfit.lens import Lens
from lensfit.optics.falloff import log_loss
from lensfit.optics.position_deviation import FRAME_GRID
from lensfit.preset.schema import Camera
from lensfit.render.overscan import cg_camera, margins_read
from lensfit.workflow.plain_numbers import plain_distance, rounded

_RADII = 40


def entry_facts(state: LensState, lens: Lens, camera: Camera) -> dict[str, Any]:
    """Curves and grids of one state, for the figures of the report."""
    d = state.distortion
    size_px = (camera.image_width_px, camera.image_height_px)
    size_mm = (camera.sensor_width_mm, camera.sensor_height_mm)
    centre = np.asarray(d.principal_point_mm)
    trip, monotone = _round_trip(lens, size_mm, size_mm[0] / size_px[0])
    display = Window.of_size(*size_px)
    needed = cg_camera(margins_read(lens, display), display, size_mm[0])
    return {
        "focal_length_mm": state.focal_length_mm,
        "focus_distance_mm": plain_distance(state.focus_distance_mm),
        "principal_distance_mm": float(d.principal_distance_mm),
        "principal_point_mm": centre.tolist(),
        "distortion_centre_mm": centre.tolist(),
        "distortion_grid": _distortion_grid(lens, size_mm),
        "radial_profile": _radial_profile(state, lens, size_mm),
        "lateral_colour": _lateral_curves(state, size_px),
        "fall_off": [
            _fall_off_curves(f)
            | {"lighting_too": is_of_lighting_too(state.geometry.takes, f.f_number)}
            for f in state.fall_off
        ],
        "uncertainty_grid": _uncertainty_grid(state, lens, size_px, size_mm),
        "monotone": monotone,
        "round_trip_max_px": trip,
        "overscan_percent": needed.percent,
    }


def is_of_lighting_too(takes: Iterable[Take], f_number: float | None) -> bool:
    """Whether a chart lit from its front was among those that gave a fall-off.

    The bright field around dark marks shows the light that fell on the chart as well.
    """
    shown = [take.observations for take in takes if take.f_number == f_number]
    return any(not marks.bright for marks in shown)


def _frame_points(size_mm, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    half = np.asarray(size_mm) / 2 * (1 + margin)
    return np.linspace(-half[0], half[0], FRAME_GRID[0]), np.linspace(
        -half[1], half[1], FRAME_GRID[1]
    )


def _mesh(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def _distortion_grid(lens: Lens, size_mm) -> dict[str, Any]:
    x, y = _frame_points(size_mm)
    points = _mesh(x, y)
    moved = in_batches(lens.distorted_from_undistorted, points) - points
    shape = (len(y), len(x))
    return {
        "x_mm": rounded(x, 4),
        "y_mm": rounded(y, 4),
        "dx_mm": [rounded(row, 5) for row in moved[:, 0].reshape(shape)],
        "dy_mm": [rounded(row, 5) for row in moved[:, 1].reshape(shape)],
    }


def _round_trip(lens: Lens, size_mm, mm_per_px: float) -> tuple[float, bool]:
    """Largest error of undistort then redistort over frame + 15 %, and no fold."""
    points = _mesh(*_frame_points(size_mm, 0.15))
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


def _radial_profile(state: LensState, lens: Lens, size_mm) -> dict[str, Any]:
    """Mean over azimuth of the relative change of radius."""
    centre = np.asarray(state.distortion.principal_point_mm)
    radius = np.linspace(0, np.hypot(*size_mm) / 2, _RADII)[1:]
    angle = 2 * np.pi * np.arange(24) / 24
    spokes = np.stack([np.cos(angle), np.sin(angle)], -1)
    points = (radius[:, None, None] * spokes[None]).reshape(-1, 2) + centre
    moved = in_batches(lens.distorted_from_undistorted, points) - centre
    ratio = np.hypot(*moved.T).reshape(len(radius), -1).mean(1) / radius
    deviation = position_deviation_mm(
        state.geometry.adjustment, state.uncertainty, points
    )
    spread = np.sqrt(np.mean(deviation.reshape(len(radius), -1) ** 2, 1)) / radius
    return {
        "radius_mm": rounded(radius, 4),
        "distortion_percent": rounded(100 * (ratio - 1), 5),
        "standard_deviation_percent": rounded(100 * spread, 6),
    }


def _lateral_curves(state: LensState, size_px) -> dict[str, Any] | None:
    if not state.colour:
        return None
    reference = float(state.distortion.reference_radius_mm)
    scale = reference / float(state.geometry.adjustment.stack.mm_per_px[0])
    limit = max(c.valid_radius for c in state.colour.values())
    radius = np.linspace(0, limit, _RADII)
    curves: dict[str, Any] = {"radius_mm": rounded(radius * reference, 4)}
    for name, colour in state.colour.items():
        value, deviation = colour.radial_px(radius, scale)
        curves[f"{name}_px"] = rounded(value, 5)
        curves[f"{name}_sd_px"] = rounded(deviation, 5)
    return curves


_log_losses = jax.jit(jax.vmap(log_loss, (0, None)))


def _fall_off_curves(fall_off) -> dict[str, Any]:
    s = np.linspace(0.0, 1.0, _RADII) ** 2
    curves: dict[str, Any] = {
        "f_number": fall_off.f_number,
        "radius_mm": rounded(np.sqrt(s) * fall_off.valid_radius_mm, 4),
    }
    for name, control in zip("rgb", fall_off.control, strict=True):
        loss = np.asarray(_log_losses(s, control))
        curves[name] = rounded(np.exp(-loss), 5)
    deviation = fall_off.deviation(np.sqrt(s) * fall_off.valid_radius_mm)
    curves["sd"] = rounded(deviation.max(0), 6)
    return curves


def _uncertainty_grid(state: LensState, lens: Lens, size_px, size_mm) -> dict[str, Any]:
    """Standard deviation of the distorted position at points of the photograph."""
    x, y = _frame_points(size_mm)
    points = in_batches(lens.undistorted_from_distorted, _mesh(x, y))
    finite = np.isfinite(points).all(-1)
    deviation = np.full(len(points), np.nan)
    deviation[finite] = position_deviation_mm(
        state.geometry.adjustment, state.uncertainty, points[finite]
    )
    deviation = deviation / (size_mm[0] / size_px[0])
    rows = deviation.reshape(len(y), len(x))
    return {
        "x_mm": rounded(x, 4),
        "y_mm": rounded(y, 4),
        "sd_px": [rounded(row, 5) for row in rows],
    }

"""Figures of a fitted state for the report: curves and grids over the frame.

Everything is plain numbers, ready for JSON; `lensfit.report` draws them.
"""

from collections.abc import Iterable
from functools import partial
from typing import Any

import jax
import numpy as np

from lensfit.batches import in_batches
from lensfit.coords import Window
from lensfit.fitting.chart_view import View
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.uncertainty import position_deviation_mm
from lensfit.lens import Lens
from lensfit.optics.falloff import log_loss
from lensfit.preset.blocks import Camera
from lensfit.rendering.overscan import cg_camera, margins_read
from lensfit.report.plain_numbers import plain_distance, rounded
from lensfit.workflow.calibration.map_curves import (
    RADII,
    distortion_grid,
    object_uncertainty_grid,
    points_over_frame,
    radial_profile,
    uncertainty_grid,
)


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
        "radial_profile": radial_profile(lens, size_mm, deviation),
        "lateral_colour": _lateral_curves(state, size_px),
        "fall_off": [
            _fall_off_curves(f)
            | {"lighting_too": is_of_lighting_too(state.geometry.takes, f.f_number)}
            for f in state.fall_off
        ],
        "uncertainty_grid": uncertainty_grid(lens, size_px, size_mm, deviation),
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
    curves: dict[str, Any] = {"radius_mm": rounded(radius * reference, 4)}
    for name, colour in state.colour.items():
        value, deviation = colour.radial_px(radius, scale)
        curves[f"{name}_px"] = rounded(value, 5)
        curves[f"{name}_sd_px"] = rounded(deviation, 5)
    return curves


_log_losses = jax.jit(jax.vmap(log_loss, (0, None)))


def _fall_off_curves(fall_off) -> dict[str, Any]:
    s = np.linspace(0.0, 1.0, RADII) ** 2
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

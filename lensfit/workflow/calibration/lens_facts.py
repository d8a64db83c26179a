"""Figures of a fitted state for the report: errors, terms, curves and grids.

Everything is plain numbers, ready for JSON; `lensfit.workflow.report` draws them.
"""

from pathlib import Path
from typing import Any

import jax
import numpy as np

from lensfit.batches import in_batches
from lensfit.coords import Window
from lensfit.fit.chief_ray import ChiefRayFit
from lensfit.fit.held_out import rms, squared_px
from lensfit.fit.lens_state import LensState
from lensfit.fit.lens_states import Fitted
from lensfit.fit.select import Verdict
from lensfit.fit.uncertainty import position_deviation_mm
from lensfit.fit.wavefront.fit import WavefrontFit
from lensfit.lens import Lens
from lensfit.optics.falloff import log_loss
from lensfit.preset.schema import Camera
from lensfit.render.uv import overscan_needed
from lensfit.workflow.calibration.blur_facts import blur_terms
from lensfit.workflow.calibration.observe import Observed
from lensfit.workflow.plain_numbers import plain_distance

_MOST_RESIDUALS = 3000
_GRID = (25, 17)
_RADII = 40


def errors_of(geometry: ChiefRayFit) -> tuple[float, float, int, int]:
    """rms px, held-out rms px, points used, points detected."""
    adjustment = geometry.adjustment
    used = adjustment.used
    detected = sum(len(t.observations) for t in geometry.takes)
    return (
        rms(squared_px(adjustment), used),
        float(geometry.held_out_rms_px),
        int(used.sum()),
        detected,
    )


def take_facts(observed: Observed, fitted: Fitted, folder: Path) -> dict[str, Any]:
    """One photograph in the report."""
    facts: dict[str, Any] = {
        "name": Path(observed.image).stem,
        "image": observed.image,
        "target": observed.target,
        "points_detected": 0,
        "points_used": 0,
        "rms_px": None,
        "held_out_rms_px": None,
        "overlay": str(observed.overlay.relative_to(folder))
        if observed.overlay
        else None,
        "notes": list(observed.notes),
        "failed": observed.failed,
    }
    if observed.resolved is not None:
        facts |= {
            "focal_length_mm": observed.resolved.focal_length_mm,
            "f_number": observed.resolved.f_number,
            "focus_distance_mm": plain_distance(observed.resolved.focus_distance_mm),
            "target_distance_mm": observed.resolved.take.target_distance_mm,
        }
    if observed.take is None:
        return facts
    facts["points_detected"] = len(observed.take.observations)
    for state in fitted.states:
        # By name: the fit may have moved a take's marks to its chief rays.
        names = [take.name for take in state.geometry.takes]
        if observed.take.name in names:
            k = names.index(observed.take.name)
            return facts | _fitted_take(state.geometry, k)
    facts["failed"] = str(fitted.failed[observed.take.name])
    return facts


def _fitted_take(geometry: ChiefRayFit, k: int) -> dict[str, Any]:
    adjustment, take = geometry.adjustment, geometry.takes[k]
    used = adjustment.used[k]
    squared = squared_px(adjustment)[k]
    count = len(take.observations)
    residual = -adjustment.residual_mm()[k] / adjustment.stack.mm_per_px[k]
    chosen = np.flatnonzero(used[:count])
    if len(chosen) > _MOST_RESIDUALS:
        chosen = np.random.default_rng(0).choice(chosen, _MOST_RESIDUALS, False)
    points = take.observations.points_px[chosen]
    return {
        "points_used": int(used.sum()),
        "rms_px": rms(squared, used),
        "held_out_rms_px": geometry.held_out_rms_px_of_take[k],
        "residuals": {
            "x_px": _rounded(points[:, 0], 2),
            "y_px": _rounded(points[:, 1], 2),
            "dx_px": _rounded(residual[chosen, 0], 4),
            "dy_px": _rounded(residual[chosen, 1], 4),
        },
    }


def terms_of(
    state: LensState, wavefront: WavefrontFit | None = None
) -> list[dict[str, Any]]:
    """Every term: kept or left, value, standard deviation, reason.

    Parameters
    ----------
    wavefront : Of its focal length.
    """
    adjustment = state.geometry.adjustment
    terms = [_principal_distance(state)]
    for verdict in _outermost(state.geometry.verdicts):
        value, sd = None, None
        where = adjustment.layout.blocks.get(verdict.family)
        if verdict.kept and where is not None:
            value = adjustment.parameters[where].tolist()
            sd = state.uncertainty.deviation(verdict.family).tolist()
        terms.append(
            {
                "name": verdict.name,
                "kept": verdict.kept,
                "value": value,
                "standard_deviation": sd,
                "unit": "",
                "reason": verdict.reason,
            }
        )
    state_of = {
        "focal_length_mm": state.focal_length_mm,
        "focus_distance_mm": plain_distance(state.focus_distance_mm),
    }
    terms = [term | state_of for term in terms]
    if wavefront is not None:
        shared = {"focal_length_mm": state.focal_length_mm}
        terms += [term | shared for term in blur_terms(wavefront)]
    return terms


def _principal_distance(state: LensState) -> dict[str, Any]:
    """The term that only views from several sides see."""
    distance_mm = float(state.distortion.principal_distance_mm)
    deviation_mm = float(state.uncertainty.deviation("focal_length")[0]) * distance_mm
    free = state.geometry.focal_length_free
    return {
        "name": "principal_distance",
        "kept": free,
        "value": distance_mm,
        "standard_deviation": deviation_mm if free else None,
        "unit": "mm",
        "reason": "the views tilt enough to determine it"
        if free
        else "stated: frontal views of a flat target do not determine it",
    }


def _outermost(verdicts: tuple[Verdict, ...]) -> list[Verdict]:
    """Of every family the largest step that was kept, and the first that was left."""
    families: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        families.setdefault(verdict.family, []).append(verdict)
    chosen = []
    for steps in families.values():
        kept = [v for v in steps if v.kept]
        chosen += kept[-1:] + [v for v in steps if not v.kept][:1]
    return chosen


def entry_facts(state: LensState, lens: Lens, camera: Camera) -> dict[str, Any]:
    """Curves and grids of one state, for the figures of the report."""
    d = state.distortion
    size_px = (camera.image_width_px, camera.image_height_px)
    size_mm = (camera.sensor_width_mm, camera.sensor_height_mm)
    centre = np.asarray(d.principal_point_mm)
    trip, monotone = _round_trip(lens, size_mm, size_mm[0] / size_px[0])
    overscan = overscan_needed(lens, Window.of_size(*size_px))
    return {
        "focal_length_mm": state.focal_length_mm,
        "focus_distance_mm": plain_distance(state.focus_distance_mm),
        "principal_distance_mm": float(d.principal_distance_mm),
        "principal_point_mm": centre.tolist(),
        "distortion_centre_mm": centre.tolist(),
        "distortion_grid": _distortion_grid(lens, size_mm),
        "radial_profile": _radial_profile(state, lens, size_mm),
        "lateral_colour": _lateral_curves(state, size_px),
        "fall_off": [_fall_off_curves(f) for f in state.fall_off],
        "uncertainty_grid": _uncertainty_grid(state, lens, size_px, size_mm),
        "monotone": monotone,
        "round_trip_max_px": trip,
        "overscan_percent": round(overscan.percent, 3),
    }


def _frame_points(size_mm, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    half = np.asarray(size_mm) / 2 * (1 + margin)
    return np.linspace(-half[0], half[0], _GRID[0]), np.linspace(
        -half[1], half[1], _GRID[1]
    )


def _mesh(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)


def _distortion_grid(lens: Lens, size_mm) -> dict[str, Any]:
    x, y = _frame_points(size_mm)
    points = _mesh(x, y)
    moved = in_batches(lens.distorted_from_undistorted, points) - points
    shape = (len(y), len(x))
    return {
        "x_mm": _rounded(x, 4),
        "y_mm": _rounded(y, 4),
        "dx_mm": [_rounded(row, 5) for row in moved[:, 0].reshape(shape)],
        "dy_mm": [_rounded(row, 5) for row in moved[:, 1].reshape(shape)],
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
        "radius_mm": _rounded(radius, 4),
        "distortion_percent": _rounded(100 * (ratio - 1), 5),
        "standard_deviation_percent": _rounded(100 * spread, 6),
    }


def _lateral_curves(state: LensState, size_px) -> dict[str, Any] | None:
    if not state.colour:
        return None
    reference = float(state.distortion.reference_radius_mm)
    scale = reference / float(state.geometry.adjustment.stack.mm_per_px[0])
    limit = max(c.valid_radius for c in state.colour.values())
    radius = np.linspace(0, limit, _RADII)
    curves: dict[str, Any] = {"radius_mm": _rounded(radius * reference, 4)}
    for name, colour in state.colour.items():
        value, deviation = colour.radial_px(radius, scale)
        curves[f"{name}_px"] = _rounded(value, 5)
        curves[f"{name}_sd_px"] = _rounded(deviation, 5)
    return curves


_log_losses = jax.jit(jax.vmap(log_loss, (0, None)))


def _fall_off_curves(fall_off) -> dict[str, Any]:
    s = np.linspace(0.0, 1.0, _RADII) ** 2
    curves: dict[str, Any] = {
        "f_number": fall_off.f_number,
        "radius_mm": _rounded(np.sqrt(s) * fall_off.valid_radius_mm, 4),
    }
    for name, control in zip("rgb", fall_off.control, strict=True):
        loss = np.asarray(_log_losses(s, control))
        curves[name] = _rounded(np.exp(-loss), 5)
    deviation = fall_off.deviation(np.sqrt(s) * fall_off.valid_radius_mm)
    curves["sd"] = _rounded(deviation.max(0), 6)
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
        "x_mm": _rounded(x, 4),
        "y_mm": _rounded(y, 4),
        "sd_px": [_rounded(row, 5) for row in rows],
    }


def _rounded(values: np.ndarray, digits: int) -> list[float | None]:
    return [
        round(float(v), digits) if np.isfinite(v) else None for v in np.asarray(values)
    ]

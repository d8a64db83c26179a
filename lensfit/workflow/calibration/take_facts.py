"""Figures of one photograph for the report: what was used of it, and what is left.

Everything is plain numbers, ready for JSON.
"""

from pathlib import Path
from typing import Any

import numpy as np

from lensfit.fitting.chief_ray import ChiefRayFit
from lensfit.fitting.held_out import rms, squared_px
from lensfit.fitting.lens_states import FittedLens
from lensfit.report.plain_numbers import plain_distance, rounded
from lensfit.workflow.calibration.observe import Observed

_MOST_RESIDUALS = 3000


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


def take_facts(observed: Observed, fitted: FittedLens, folder: Path) -> dict[str, Any]:
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
            "x_px": rounded(points[:, 0], 2),
            "y_px": rounded(points[:, 1], 2),
            "dx_px": rounded(residual[chosen, 0], 4),
            "dy_px": rounded(residual[chosen, 1], 4),
        },
    }

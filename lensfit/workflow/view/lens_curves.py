"""Curves of a lens at one state with standard deviations, for the report's figures.

Distortion, lateral colour, fall-off and breathing of a preset alone: what the report of
a calibration draws from the fit, computed from the lens and its covariances.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from lensfit.errors import LensfitError
from lensfit.lens import Channel, Lens
from lensfit.preset.blocks import Camera
from lensfit.preset.schema import Preset
from lensfit.report.plain_numbers import rounded_numbers
from lensfit.units import dioptres_from_mm, mm_from_dioptres
from lensfit.workflow.calibration.entry_facts import (
    RADII,
    distortion_grid,
    position_deviation_of,
    radial_profile,
    uncertainty_grid,
)

Facts = dict[str, Any]
_FOCUSES = 17


def lens_facts(lens: Lens, stops: list[Lens], camera: Camera) -> Facts:
    """What `lensfit.report.plots.entry_figures` draws.

    Parameters
    ----------
    stops : The lens at each f-number whose fall-off is drawn.
    """
    size_px = camera.image_width_px, camera.image_height_px
    size_mm = camera.sensor_width_mm, camera.sensor_height_mm
    known = position_deviation_of(lens)
    centre = np.asarray(lens.distortion.principal_point_mm).tolist()
    facts: Facts = {
        "principal_point_mm": centre,
        "distortion_centre_mm": centre,
        "distortion_grid": distortion_grid(lens, size_mm),
        "radial_profile": radial_profile(lens, size_mm, known),
        "lateral_colour": _lateral_colour(lens, size_mm, size_mm[0] / size_px[0]),
        "fall_off": [_fall_off(one, size_mm) for one in stops if one.illumination],
    }
    if known is not None:
        facts["uncertainty_grid"] = uncertainty_grid(lens, size_px, size_mm, known)
    return facts


def _radii_along_x(
    lens: Lens, size_mm: tuple[float, float]
) -> tuple[Float[np.ndarray, " radii"], Float[np.ndarray, "radii 2"]]:
    """Radii from the principal point to the corner, and points of them to its right."""
    radius = np.linspace(0, math.hypot(*size_mm) / 2, RADII)
    centre = np.asarray(lens.distortion.principal_point_mm)
    return radius, centre + np.stack([radius, np.zeros_like(radius)], -1)


def _lateral_colour(
    lens: Lens, size_mm: tuple[float, float], pixel_mm: float
) -> Facts | None:
    """How far red and blue land outward of green, along x."""
    if not lens.has_lateral_colour:
        return None
    radius, points = _radii_along_x(lens, size_mm)
    green = np.asarray(lens.distorted_from_undistorted(points))
    curves: Facts = {"radius_mm": rounded_numbers(radius, 4)}
    channel: Channel
    for channel in ("r", "b"):
        landed = np.asarray(lens.distorted_from_undistorted(points, channel))
        shift_px = (landed - green)[:, 0] / pixel_mm
        curves[f"{channel}_px"] = rounded_numbers(shift_px, 5)
        known = _deviation_or_none(
            lambda c=channel: lens.lateral_colour_standard_deviation_mm(green, c)
        )
        if known is not None:
            curves[f"{channel}_sd_px"] = rounded_numbers(known[:, 0] / pixel_mm, 5)
    return curves


def _fall_off(lens: Lens, size_mm: tuple[float, float]) -> Facts:
    radius, points = _radii_along_x(lens, size_mm)
    curves: Facts = {"f_number": lens.f_number, "radius_mm": rounded_numbers(radius, 4)}
    channel: Channel
    for channel in ("r", "g", "b"):
        curves[channel] = rounded_numbers(
            lens.relative_illumination(points, channel), 5
        )
    known = _deviation_or_none(lambda: lens.illumination_standard_deviation(points))
    return curves if known is None else curves | {"sd": rounded_numbers(known, 6)}


def _deviation_or_none(deviation: Callable[[], np.ndarray]) -> np.ndarray | None:
    try:
        return deviation()
    except LensfitError:
        return None


def breathing_facts(preset: Preset, lens: Lens) -> Facts | None:
    """How much larger the image is than focused farthest, over what was photographed.

    None where fewer than two focus distances of a focal length were.

    Parameters
    ----------
    lens : At the state that is looked at; its focal length counts.
    """
    focal = min(
        {entry.focal_length_mm for entry in preset.entries},
        key=lambda mm: abs(mm - lens.focal_length_mm),
    )
    photographed_mm = {
        e.focus_distance_mm
        for e in preset.entries
        if e.focal_length_mm == focal and e.focus_distance_mm is not None
    }
    if len(photographed_mm) < 2:
        return None
    marks = [dioptres_from_mm(mm) for mm in photographed_mm]
    between = np.linspace(min(marks), max(marks), _FOCUSES)[1:-1]
    focuses_mm = sorted(
        photographed_mm.union(mm_from_dioptres(float(d)) for d in between), reverse=True
    )
    sizes = [_principal_distance_mm(preset, focal, mm) for mm in focuses_mm]
    deviation = np.array([_relative_deviation(preset, focal, mm) for mm in focuses_mm])
    return {
        "focus_dioptres": rounded_numbers(
            np.array([dioptres_from_mm(mm) for mm in focuses_mm]), 6
        ),
        "larger_percent": rounded_numbers(100 * (np.array(sizes) / sizes[0] - 1), 5),
        "sd_percent": rounded_numbers(100 * deviation, 6),
        "photographed_dioptres": sorted(marks),
    }


def _principal_distance_mm(preset: Preset, focal_mm: float, focus_mm: float) -> float:
    chosen = preset.select(focal_mm, None, focus_mm)
    return chosen.entry.projection.principal_distance_mm


def _relative_deviation(preset: Preset, focal_mm: float, focus_mm: float) -> float:
    """Of the principal distance; NaN if unknown, as between photographs, or
    where it follows from what was stated."""
    known = preset.at(focal_mm, None, focus_mm).covariances.distortion
    variance = 0.0 if known is None else known[0, 0]
    return math.sqrt(variance) if variance > 0 else math.nan

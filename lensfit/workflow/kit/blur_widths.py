"""Width of a point's image in focus, over the frame, for the table of a kit.

The width is the diameter of the disc of the same second moments, ``4 sqrt(variance)``
with the mean variance of both directions, as everywhere in lensfit.
"""

from typing import Any

import numpy as np

from lensfit.preset.schema import Preset

_SIZE_PX = 65
_PLACES = {"centre": 0.0, "middle": 0.5, "edge": 0.9}
"""Parts of the half diagonal, along the frame's diagonal."""


def blur_widths(preset: Preset) -> list[dict[str, Any]]:
    """Of every focal length with a measured blur, wide open, focused half way.

    Returns
    -------
    Each "focal_length_mm", "f_number", "focus_distance_mm" and the widths "centre_px",
    "middle_px" and "edge_px" of green.
    """
    rows = []
    measured = [entry for entry in preset.entries if entry.blur is not None]
    for focal_mm in dict.fromkeys(entry.focal_length_mm for entry in measured):
        mine = [e for e in measured if e.focal_length_mm == focal_mm]
        focuses = sorted(e.focus_distance_mm for e in mine if e.focus_distance_mm)
        stops = [f.f_number for e in mine for f in e.fall_off if f.f_number is not None]
        if focuses and stops:
            focus_mm = focuses[len(focuses) // 2]
            rows.append(_row(preset, focal_mm, min(stops), focus_mm))
    return rows


def _row(
    preset: Preset, focal_mm: float, f_number: float, focus_mm: float
) -> dict[str, Any]:
    camera = preset.camera
    lens = preset.at(
        focal_length_mm=focal_mm, f_number=f_number, focus_distance_mm=focus_mm
    )
    pitch_mm = camera.sensor_width_mm / camera.image_width_px
    half = np.array([camera.sensor_width_mm, camera.sensor_height_mm]) / 2
    row: dict[str, Any] = {
        "focal_length_mm": focal_mm,
        "f_number": f_number,
        "focus_distance_mm": focus_mm,
    }
    for name, part in _PLACES.items():
        spread = lens.psf(
            part * half, focus_mm, channel="g", pixel_pitch_mm=pitch_mm,
            size_px=_SIZE_PX,
        )  # fmt: skip
        row[f"{name}_px"] = round(width_px(np.asarray(spread)), 3)
    return row


def width_px(spread: np.ndarray) -> float:
    """Diameter of the disc of the same second moments as a point-spread function."""
    weight = spread / spread.sum()
    total = 0.0
    for axis in (0, 1):
        place = np.arange(weight.shape[axis])
        along = weight.sum(1 - axis)
        mean = float((along * place).sum())
        total += float((along * (place - mean) ** 2).sum())
    return 4 * float(np.sqrt(total / 2))

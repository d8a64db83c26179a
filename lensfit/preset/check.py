"""What types cannot say about a preset: list lengths, order, and no state twice."""

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from lensfit.errors import PresetError
from lensfit.preset.blocks import Distortion, FallOff, LateralColour
from lensfit.preset.check_blur import blur_faults
from lensfit.preset.check_covariance import covariance_faults
from lensfit.preset.covariance import fall_off_names, lateral_names
from lensfit.preset.entry import Entry
from lensfit.preset.schema import Camera, Preset

_LONGEST = {"decentering": 4, "thin_prism": 4, "anamorphic": 8}
_LOPSIDED = 2
"""Coefficients of a channel that differ between azimuths."""
_DARKEST = 50.0
"""Loss as -ln of the light: less than 1e-21 of it is none."""
_LONGEST_MM = 1e9
"""A thousand kilometres; lenses that are nearly telecentric have pupils far away."""
_LARGEST_F_NUMBER = 1000.0


def check_preset(preset: Preset, where: str | Path) -> None:
    """Refuse a preset with a key that cannot be right.

    Raises
    ------
    PresetError : There is one; the first is named.
    """
    for index, entry in enumerate(preset.entries):
        for key, what in _faults(entry, _frame_radius_mm(entry, preset.camera)):
            raise PresetError(f"entries[{index}].{key}: {what}", where=where)
    states: dict[tuple[float, float | None], int] = {}
    for index, entry in enumerate(preset.entries):
        state = (entry.focal_length_mm, entry.focus_distance_mm)
        if state in states:
            raise PresetError(
                f"entries[{index}]: the lens at {entry} is entries[{states[state]}] "
                "again; keep one of them",
                where=where,
            )
        states[state] = index


def _frame_radius_mm(entry: Entry, camera: Camera) -> float:
    """From the principal point to the furthest corner of the sensor."""
    x, y = entry.projection.principal_point_mm
    return math.hypot(
        camera.sensor_width_mm / 2 + abs(x), camera.sensor_height_mm / 2 + abs(y)
    )


def _faults(entry: Entry, frame_radius_mm: float) -> Iterator[tuple[str, str]]:
    for key, length in _lengths(entry):
        if not abs(length) <= _LONGEST_MM:
            yield key, f"{length:g} is no length of a lens, in mm"
    for key, what in _distortion_faults(entry.distortion):
        yield f"distortion.{key}", what
    if entry.lateral_colour is not None:
        for key, what in _lateral_faults(entry.lateral_colour):
            yield f"lateral_colour.{key}", what
    stops = [fall_off.f_number for fall_off in entry.fall_off]
    if len(set(stops)) < len(stops):
        yield "fall_off", "an f-number stands twice"
    for index, fall_off in enumerate(entry.fall_off):
        for key, what in _fall_off_faults(fall_off):
            yield f"fall_off[{index}].{key}", what
    if entry.blur is not None:
        for key, what in blur_faults(entry.blur, frame_radius_mm):
            yield f"blur.{key}", what
    if entry.covariance is not None:
        for key, what in covariance_faults(entry.covariance):
            yield f"covariance.{key}", what


def _lengths(entry: Entry) -> Iterator[tuple[str, float]]:
    projection = entry.projection
    yield "focal_length_mm", entry.focal_length_mm
    yield "projection.principal_distance_mm", projection.principal_distance_mm
    yield "projection.entrance_pupil_offset_mm", projection.entrance_pupil_offset_mm
    for axis, place in zip("xy", projection.principal_point_mm, strict=True):
        yield f"projection.principal_point_mm.{axis}", place
    yield "distortion.reference_radius_mm", entry.distortion.reference_radius_mm


def _distortion_faults(distortion: Distortion) -> Iterator[tuple[str, str]]:
    x0, y0, x1, y1 = distortion.valid_box
    if not (x0 < x1 and y0 < y1):
        yield "valid_box", "is no box x0, y0, x1, y1 with x0 < x1 and y0 < y1"
    for key, longest in _LONGEST.items():
        if len(getattr(distortion, key)) > longest:
            yield key, f"has more than {longest} coefficients"
    field = distortion.field
    if field is None:
        return
    count = (field.degree + 1) * (field.degree + 2) // 2 - 6
    for axis in ("x", "y"):
        if len(getattr(field, axis)) != count:
            yield (
                f"field.{axis}",
                f"needs {count} coefficients at degree {field.degree}",
            )


def _lateral_faults(lateral: LateralColour) -> Iterator[tuple[str, str]]:
    for channel in ("r", "b"):
        for key in ("strain", "decentering"):
            if len(getattr(getattr(lateral, channel), key)) not in (0, _LOPSIDED):
                yield f"{channel}.{key}", f"needs {_LOPSIDED} coefficients, or none"
    if lateral.covariance is None:
        return
    for channel in ("r", "b"):
        covariance = getattr(lateral.covariance, channel)
        names = lateral_names(len(getattr(lateral, channel).radial))
        for key, what in covariance_faults(covariance, names):
            yield f"covariance.{channel}.{key}", what


def _fall_off_faults(fall_off: FallOff) -> Iterator[tuple[str, str]]:
    if fall_off.f_number is not None and fall_off.f_number > _LARGEST_F_NUMBER:
        yield "f_number", f"{fall_off.f_number:g} is none of a lens"
    for key in ("r", "g", "b"):
        control = getattr(fall_off, key)
        if not control or len(control) != len(fall_off.g):
            yield key, "needs at least one number, and as many as the other channels"
        if any(b < a for a, b in pairwise((0.0, *control))):
            yield key, "falls somewhere; control values rise from 0"
        if max(control, default=0.0) > _DARKEST:
            yield key, f"is over {_DARKEST:g}: no light would be left"
    if fall_off.covariance is None:
        return
    for channel in ("r", "g", "b"):
        covariance = getattr(fall_off.covariance, channel)
        names = fall_off_names(channel, len(fall_off.g))
        for key, what in covariance_faults(covariance, names):
            yield f"covariance.{channel}.{key}", what

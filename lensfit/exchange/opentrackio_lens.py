"""The lens that OpenTrackIO samples describe, in lensfit's units.

Millimetres on the sensor, x right, y down, origin at its centre.
Source: camdkit's lens types and schema (SMPTE RIS), OpenLensIO 1.0.1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from lensfit.errors import ExchangeError
from lensfit.exchange.brown_conrady import D_U, BrownMap
from lensfit.exchange.foreign import (
    ForeignFallOff,
    ForeignLens,
    ForeignState,
    PointFunction,
    Points,
    StatedValues,
    assumed_size_px,
)


@dataclass(frozen=True)
class ColourShift:
    """Where a channel lands against green, as `lensfit.preset.blocks.ChannelShift`."""

    reference_radius_mm: float
    valid_radius: float
    shift_mm: tuple[float, float]
    strain: tuple[float, float]
    decentering: tuple[float, float]
    radial: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class LensSample:
    """The lens and camera of one sample.

    Attributes
    ----------
    distortions : One or both directions, about the same centre.
    projection_offset_mm : dP.
    falloff : a1, a2, a3; empty when there is none.
    nominal_focal_length_mm : As on the barrel, or None.
    is_prime : Whether the standard's field for that may be used: a zoom has none.
    overscan : Factor (>= 1) that holds the undistorted frame; None when not stated.
    colour : "r" and "b", or empty.
    """

    name: str
    sensor_size_mm: tuple[float, float] | None
    size_px: tuple[int, int] | None
    distortions: tuple[BrownMap, ...]
    projection_offset_mm: tuple[float, float]
    pinhole_focal_length_mm: float
    nominal_focal_length_mm: float | None = None
    is_prime: bool = True
    focus_distance_mm: float | None = None
    f_number: float | None = None
    entrance_pupil_offset_mm: float | None = None
    falloff: tuple[float, ...] = ()
    overscan: float | None = None
    serial: str | None = None
    camera_model: str | None = None
    colour: Mapping[str, ColourShift] = field(default_factory=dict)
    history: tuple[str, ...] = ()


def lens_of_opentrackio(
    samples: tuple[LensSample, ...], stated: StatedValues, where: str | Path
) -> ForeignLens:
    """The lens of the samples, one state each; what is stated counts for all.

    Raises
    ------
    ExchangeError : The sensor size is not stated.
    """
    first = samples[0]
    sensor = first.sensor_size_mm
    if stated.sensor_width_mm is not None:
        aspect = sensor[1] / sensor[0] if sensor else _aspect(stated, where)
        sensor = (stated.sensor_width_mm, stated.sensor_width_mm * aspect)
    if sensor is None:
        raise ExchangeError(
            "does not state the sensor (activeSensorPhysicalDimensions)",
            where=where,
            remedy="give --sensor-width-mm and --size",
        )
    size = stated.size_px or first.size_px
    notes = []
    if size is None:
        size = assumed_size_px(sensor)
        notes.append(f"the file does not say its pixels; {size[0]} x {size[1]} assumed")
    if any(len(sample.distortions) > 1 for sample in samples):
        notes.append(f"of both directions of distortion, {D_U} is used")
    return ForeignLens(
        "OpenTrackIO",
        first.name,
        sensor,
        size,
        tuple(_state(sample, stated) for sample in samples),
        first.serial,
        first.camera_model,
        tuple(notes),
    )


def _aspect(stated: StatedValues, where: str | Path) -> float:
    if stated.size_px is None:
        raise ExchangeError(
            "does not state the height of the sensor", where=where, remedy="give --size"
        )
    return stated.size_px[1] / stated.size_px[0]


def _state(sample: LensSample, stated: StatedValues) -> ForeignState:
    by_model = {one.model: one for one in sample.distortions}
    focal = stated.focal_length_mm or sample.nominal_focal_length_mm
    fall_off = ()
    if sample.falloff:
        light = partial(_illumination, falloff=sample.falloff)
        fall_off = (ForeignFallOff(stated.f_number or sample.f_number, light),)
    return ForeignState(
        map=by_model.get(D_U, sample.distortions[0]),
        principal_distance_mm=sample.pinhole_focal_length_mm,
        principal_point_mm=sample.projection_offset_mm,
        focal_length_mm=focal or sample.pinhole_focal_length_mm,
        focus_distance_mm=stated.focus_distance_mm or sample.focus_distance_mm,
        entrance_pupil_offset_mm=sample.entrance_pupil_offset_mm,
        channels=_channels(sample.colour, sample.projection_offset_mm),
        fall_off=fall_off,
    )


def _illumination(points_mm: Points, falloff: tuple[float, ...]) -> np.ndarray:
    r2 = np.sum(np.asarray(points_mm, float) ** 2, -1)
    a1, a2, a3 = (*falloff, 0.0, 0.0)[:3]
    return 1 - r2 * (a1 + r2 * (a2 + r2 * a3))


def _channels(
    colour: Mapping[str, ColourShift], centre_mm: tuple[float, float]
) -> dict[str, PointFunction]:
    return {
        channel: partial(_channel_from_green, shift=shift, centre_mm=centre_mm)
        for channel, shift in colour.items()
    }


def _channel_from_green(
    green_mm: Points, shift: ColourShift, centre_mm: tuple[float, float]
) -> Points:
    q = (np.asarray(green_mm, float) - np.array(centre_mm)) / shift.reference_radius_mm
    x, y = q[:, 0], q[:, 1]
    r2 = x * x + y * y
    relative = np.polynomial.polynomial.polyval(r2, [*shift.radial, 0.0])
    s1, s2 = shift.strain
    d1, d2 = shift.decentering
    moved = q * relative[:, None]
    moved[:, 0] += s1 * x + s2 * y + d1 * 2 * x * y + d2 * (r2 + 2 * x * x)
    moved[:, 1] += s2 * x - s1 * y + d1 * (r2 + 2 * y * y) + d2 * 2 * x * y
    return green_mm + np.array(shift.shift_mm) + moved * shift.reference_radius_mm

"""One OpenTrackIO sample, as far as it is about the lens, in lensfit's units.

Millimetres on the sensor, x right, y down, origin at its centre.
Source: camdkit's lens types and schema (SMPTE RIS), OpenLensIO 1.0.1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from lensfit.preset.exchange.brown_conrady import BrownMap


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

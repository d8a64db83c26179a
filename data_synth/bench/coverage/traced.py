"""What a tracer knows of a lens, as it is compared with what a calibration predicts.

Millimetres on the sensor, x right and y down from its centre; object points from the
axis. Every array holds what lies in the frame, thinned out.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class TracedChiefs:
    """Where chief rays of a flat object land, at one focus.

    Attributes
    ----------
    focus_distance_mm : As on the barrel.
    object_mm : Across the object, in a plane square to the axis.
    landed_mm : Of red, green and blue.
    """

    focus_distance_mm: float
    object_mm: Float[np.ndarray, "points 2"]
    landed_mm: Float[np.ndarray, "points 3 2"]


@dataclass(frozen=True)
class TracedLight:
    """Relative illumination at points of a photograph, at one setting."""

    f_number: float
    focus_distance_mm: float
    points_mm: Float[np.ndarray, "points 2"]
    light: Float[np.ndarray, "points 3"]


@dataclass(frozen=True)
class TracedSpots:
    """Green point-spread functions at one setting, each of sum 1."""

    f_number: float
    focus_distance_mm: float
    object_distance_mm: float
    pitch_mm: float
    points_mm: Float[np.ndarray, "points 2"]
    psf: Float[np.ndarray, "points size size"]


@dataclass(frozen=True)
class Traced:
    """All that is compared; every array holds what lies in the frame."""

    focal_length_mm: float
    pixel_mm: float
    chiefs: tuple[TracedChiefs, ...]
    light: tuple[TracedLight, ...]
    spots: tuple[TracedSpots, ...]

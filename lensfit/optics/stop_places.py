"""Places in the stop and its edge, as a program outside lensfit needs them.

Places count from the middle of the stop in its own radii, x right and y down; what they
and the blades are is said in `lensfit.optics.pupil`.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Float

from lensfit.optics.pupil import (
    SHARPNESS,
    Pupil,
    blade_apothem,
    blade_sectors,
    middle_of_stop,
    stretch_matrix,
)


def rays_at_stop(
    place: Float[Array, "rays 2"],
    h: Float[Array, "2"],
    stop_radius: Float[Array, ""],
    pupil: Pupil,
) -> Float[Array, "rays 2"]:
    """u of rays at places of the stop: the inverse of `pupil.places_in_stop`."""
    middle = middle_of_stop(h, stop_radius, pupil)
    return (middle[None] + stop_radius * place) @ stretch_matrix(h, pupil)


class StopArcs(NamedTuple):
    """The edge of the stop: one arc for each blade.

    An arc of curvature k at distance d, with normal n, lets a place s through where
    k |s|^2 / 2 + (1 - k d) n.s <= d - k d^2 / 2.

    Attributes
    ----------
    azimuth_rad : Of the normals, from x towards y.
    distance, curvature : d and k, the same for all.
    """

    azimuth_rad: Float[np.ndarray, " arcs"]
    distance: float
    curvature: float

    @property
    def reach(self) -> float:
        """Radius of the smallest disc about the middle that holds the opening."""
        d, k, arcs = self.distance, self.curvature, len(self.azimuth_rad)
        b = (1 - k * d) * math.cos(math.pi / arcs) if arcs > 1 else 0.0
        c = d - k * d * d / 2
        return 2 * c / (b + math.sqrt(b * b + 2 * k * c))

    def passes(self, places: Float[np.ndarray, "rays 2"]) -> np.ndarray:
        """Whether the blades let places through."""
        d, k = self.distance, self.curvature
        normal = np.stack([np.cos(self.azimuth_rad), np.sin(self.azimuth_rad)])
        bent = k / 2 * np.sum(places**2, -1, keepdims=True)
        return (bent + (1 - k * d) * (places @ normal) <= d - k * d * d / 2).all(-1)


def stop_arcs(pupil: Pupil) -> StopArcs:
    """The blades as `pupil.places_in_stop` has them, with sharp corners."""
    curvature, used, sector = (np.asarray(part) for part in blade_sectors(pupil))
    first = float(pupil.blade_rotation_rad) + float(sector) / 2
    distance = float(blade_apothem(pupil, SHARPNESS))
    azimuth = first + float(sector) * np.arange(int(used.sum()))
    return StopArcs(azimuth, distance, float(curvature) / distance)

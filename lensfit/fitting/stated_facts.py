"""What is stated of the views of one lens state, and how well each number is known.

Widths are standard deviations: of an engraved focal length, of an f-number, of a tape
measure, of a printed chart. Distances count from the sensor.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensfit.fitting.usual_lens import KnownPerspective

_PUPIL_MAGNIFICATION = 0.5
"""How far 1 / (pupil magnification) is from 1 in usual lenses."""


@dataclass(frozen=True)
class Widths:
    """Standard deviations of what is stated; shares are of the stated value.

    Attributes
    ----------
    focal_length : Share.
    f_number : Share of the stop's diameter.
    distance_mm, distance : Of a distance from the sensor mark; both count.
    pitch : Share.
    diameter : Share, of a dot's.
    """

    focal_length: float = 0.03
    f_number: float = 0.05
    distance_mm: float = 5.0
    distance: float = 0.003
    pitch: float = 0.001
    diameter: float = 0.01

    def of_distance_mm(self, stated_mm: float) -> float:
        """Of a board's distance, which the pitch of its chart scales as well."""
        share = math.hypot(self.distance, self.pitch)
        return math.hypot(self.distance_mm, share * stated_mm)


ORDINARY_WIDTHS = Widths()


@dataclass(frozen=True, eq=False)
class Facts:
    """What is stated of the views of one lens state, in the order of its arrays.

    Attributes
    ----------
    names : Of the photographs.
    focal_length_mm : Behind cylinders the geometric mean of both axes'.
    engraving : By which the focal length is to be multiplied to be the stated one.
    magnification : At the focus distance.
    target_distance_mm : From the sensor; NaN where nobody measured it.
    shared : How many views share each distance.
    perspective : Of the lens, before its photographs are seen.
    widths : Of all statements.
    """

    names: tuple[str, ...]
    focal_length_mm: float
    engraving: float
    magnification: float
    target_distance_mm: Float[np.ndarray, " views"]
    shared: Float[np.ndarray, " views"]
    perspective: KnownPerspective
    widths: Widths

    @property
    def principal_distance_mm(self) -> float:
        """That goes with the stated focal length."""
        return self.focal_length_mm * (1 + self.magnification)

    @property
    def focal_length_width(self) -> float:
        """Of ln(principal distance): pupils that are magnified, and groups that move
        inside, change how it grows towards near focus."""
        return math.hypot(
            self.widths.focal_length, _PUPIL_MAGNIFICATION * self.magnification
        )


def views_sharing(keys: Sequence[tuple]) -> Float[np.ndarray, " views"]:
    """How many of the views have the same key."""
    return np.array([float(sum(other == key for other in keys)) for key in keys])

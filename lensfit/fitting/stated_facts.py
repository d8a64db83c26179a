"""Stated values of the views of one lens state, and their standard deviations.

Widths are standard deviations: of an engraved focal length, an f-number, a tape
measure, a printed chart. Distances count from the sensor.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensfit.fitting.usual_lens import KnownPerspective

PUPIL_MAGNIFICATION_WIDTH = 0.5
"""Standard deviation of 1 / (pupil magnification) from 1 in usual lenses."""


@dataclass(frozen=True)
class Widths:
    """Standard deviations of stated values; shares are relative to the value.

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
        """Of a board's distance, including the error of the chart's pitch."""
        share = math.hypot(self.distance, self.pitch)
        return math.hypot(self.distance_mm, share * stated_mm)


ORDINARY_WIDTHS = Widths()


@dataclass(frozen=True, eq=False)
class Facts:
    """Stated values of the views of one lens state, in the order of its arrays.

    Attributes
    ----------
    names : Of the photographs.
    focal_length_mm : Of anamorphic lenses the geometric mean of both axes.
    engraving : Stated focal length over `focal_length_mm`.
    magnification : At the focus distance.
    target_distance_mm : From the sensor; NaN if not measured.
    shared : Number of views that share each distance.
    perspective : Prior of the entrance pupil and its shift with field angle.
    widths : Standard deviations of the stated values.
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
        """Principal distance of the stated focal length at the focus distance."""
        return self.focal_length_mm * (1 + self.magnification)

    @property
    def focal_length_width(self) -> float:
        """Standard deviation of ln(principal distance): pupil magnification and moving
        groups change how it increases towards near focus."""
        return math.hypot(
            self.widths.focal_length, PUPIL_MAGNIFICATION_WIDTH * self.magnification
        )


def views_sharing(keys: Sequence[tuple]) -> Float[np.ndarray, " views"]:
    """For each view, how many views have the same key."""
    return np.array([float(sum(other == key for other in keys)) for key in keys])

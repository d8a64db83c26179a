"""The input of a fit: views of charts.

A view is the detections of one photograph, together with the dimensions of the target
and the state of the lens (a `[[take]]` of a shoot file, searched). Distances count from
the sensor plane.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensfit.detect.dot_images import DotImages
from lensfit.detect.observations import Observations
from lensfit.units import dioptres_from_mm

_SAME_FOCUS_DIOPTRES = 1e-3


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
class View:
    """One photograph of one target.

    Attributes
    ----------
    name : Of the photograph, for messages.
    target : Name of the target; views of one target share its errors.
    observations : The detected points.
    pitch_mm : Distance of neighbouring points, to the right and down on the target.
    mark_diameter_mm : Diameter of a dot, width of a line; None for corners, and where
        it is not known.
    focal_length_mm : As on the barrel.
    sensor_size_mm : Width and height that the photograph spans.
    f_number, focus_distance_mm, target_distance_mm : None where not stated.
    squeeze : Nominal horizontal squeeze of an anamorphic lens.
    dot_images : Pictures of the detections, where their shape can be fitted.
    rims : Of their rims, where these show finer cells.
    chief_rays : Whether detections are where chief rays land, not centroids.
    shared_moves_mm : How detections that were placed so move together, red, green and
        blue, by every independent error of what placed them, one standard deviation
        each.
    colour_moves_mm : How such detections move by the wavefront's terms of colour, each
        as large as any lens has it.
    colour_orders : Orders of these terms.
    widths : How well what is stated is known, and the diameter of dots.
    """

    name: str
    target: str
    observations: Observations
    pitch_mm: tuple[float, float]
    mark_diameter_mm: float | None
    focal_length_mm: float
    sensor_size_mm: tuple[float, float]
    f_number: float | None = None
    focus_distance_mm: float | None = None
    target_distance_mm: float | None = None
    squeeze: float = 1.0
    dot_images: DotImages | None = None
    rims: DotImages | None = None
    chief_rays: bool = False
    shared_moves_mm: Float[np.ndarray, "moves 3 detections 2"] | None = None
    colour_moves_mm: Float[np.ndarray, "terms 3 detections 2"] | None = None
    colour_orders: tuple[int, ...] = ()
    widths: Widths = ORDINARY_WIDTHS

    @property
    def pixel_mm(self) -> Float[np.ndarray, "2"]:
        """Width and height of a pixel on the sensor."""
        size_px = np.asarray(self.observations.image_size_px)
        return np.asarray(self.sensor_size_mm) / size_px

    @property
    def corner_mm(self) -> float:
        """Of the frame, from its middle."""
        return math.hypot(*self.sensor_size_mm) / 2

    @property
    def anamorphic(self) -> bool:
        """Whether the lens is stated to squeeze one axis."""
        return self.squeeze != 1.0


def views_by_state(views: list[View]) -> list[list[View]]:
    """Views of one focal length and focus distance together, in order.

    Focus distances that no barrel tells apart (`_SAME_FOCUS_DIOPTRES`) are one.
    """
    groups: list[list[View]] = []
    for view in views:
        same = (group for group in groups if _same_state(group[0], view))
        group = next(same, None)
        if group is None:
            groups.append([view])
        else:
            group.append(view)
    return groups


def _same_state(one: View, other: View) -> bool:
    if one.focal_length_mm != other.focal_length_mm:
        return False
    if one.focus_distance_mm is None or other.focus_distance_mm is None:
        return one.focus_distance_mm is other.focus_distance_mm
    apart = dioptres_from_mm(one.focus_distance_mm) - dioptres_from_mm(
        other.focus_distance_mm
    )
    return abs(apart) < _SAME_FOCUS_DIOPTRES

"""The camera before a chart: a thin lens, a sensor, and the takes that measure blur.

With focal length f and distances D from the sensor, as on the barrel, the lens is
``s = (D + sqrt(D^2 - 4 f D)) / 2`` from what it is focused on, and its magnification is
``m = f / (s - f)``. Focused at S1 from the lens, a point at S2 from it is a disc of
diameter ``|S2 - S1| / S2 * f^2 / (N (S1 - f))``.

All of it follows from ``1/f = 1/s + 1/s'`` with ``D = s + s'`` (W. J. Smith, Modern
Optical Engineering, on image formation).

Takes by which blur is measured are in focus, nearer and farther, at the f-number and
two stops down; out of focus as far as shows the pupil without letting dots run into
each other.
"""

import math
from dataclasses import dataclass

from lensfit.errors import ChartError


@dataclass(frozen=True)
class Camera:
    """A lens and a sensor.

    Attributes
    ----------
    noise_percent : Of a pixel, standard deviation, as part of white.
    """

    focal_length_mm: float
    f_number: float
    sensor_width_mm: float
    size_px: tuple[int, int]
    noise_percent: float = 0.5

    @property
    def pixel_mm(self) -> float:
        """Pitch of the photosites."""
        return self.sensor_width_mm / self.size_px[0]

    @property
    def sensor_mm(self) -> tuple[float, float]:
        """Width and height."""
        return self.sensor_width_mm, self.size_px[1] * self.pixel_mm

    def check(self) -> None:
        """Refuse what no camera is.

        Raises
        ------
        ChartError : A number is not positive.
        """
        for name in ("focal_length_mm", "f_number", "sensor_width_mm", "noise_percent"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                option = "--" + name.replace("_", "-")
                raise ChartError(f"{option} {value:g} is not positive")


def object_distance_mm(focal_length_mm: float, distance_mm: float) -> float:
    """From a thin lens to what it is focused on, at a distance from the sensor.

    Raises
    ------
    ChartError : Nearer than four focal lengths nothing is in focus.
    """
    room = distance_mm**2 - 4 * focal_length_mm * distance_mm
    if not (math.isfinite(distance_mm) and room >= 0 and distance_mm > 0):
        raise ChartError(
            f"a chart at {distance_mm:g} mm cannot be in focus at "
            f"{focal_length_mm:g} mm focal length",
            remedy="distances are from the sensor, in mm: at least four focal lengths",
        )
    return (distance_mm + math.sqrt(room)) / 2


def magnification_at(focal_length_mm: float, distance_mm: float) -> float:
    """Image over object size of what is in focus at a distance from the sensor.

    Raises
    ------
    ChartError : As `object_distance_mm`.
    """
    away = object_distance_mm(focal_length_mm, distance_mm)
    return focal_length_mm / (away - focal_length_mm)


def blur_mm(
    focal_length_mm: float,
    f_number: float,
    focus_distance_mm: float,
    chart_distance_mm: float,
) -> float:
    """Diameter on the sensor of a point of the chart; distances from the sensor.

    Raises
    ------
    ChartError : As `object_distance_mm`, of the focus distance.
    """
    focused = object_distance_mm(focal_length_mm, focus_distance_mm)
    away = chart_distance_mm - (focus_distance_mm - focused)
    circle = focal_length_mm**2 / (f_number * (focused - focal_length_mm))
    return abs(away - focused) / away * circle


def distance_of_magnification_mm(focal_length_mm: float, magnification: float) -> float:
    """From the sensor to an object that is imaged at this magnification."""
    return focal_length_mm * (2 + magnification + 1 / magnification)


_BLUR_PITCHES = 0.4
"""Blur of the out-of-focus takes, wide open: enough to show the pupil, and apart."""
_NEAREST_PART, _FARTHEST_PART = 0.715, 1.65
"""How far the focus ring is turned at most, in distances of the chart."""
_NEAREST_FOCAL_LENGTHS = 4.0001
"""At four a lens images at life size; nearer, nothing is in focus."""


@dataclass(frozen=True)
class FocusTake:
    """One setting of focus ring and iris on the standing chart.

    Attributes
    ----------
    blur_px : Diameter of a point's disc.
    overlapping : Dots run into each other.
    """

    name: str
    f_number: float
    focus_distance_mm: float
    blur_px: float
    overlapping: bool


def focus_takes(
    camera: Camera, chart_mm: float, mark_px: float, pitch_px: float
) -> tuple[FocusTake, ...]:
    """Takes in focus, nearer and farther; at the f-number and two stops down.

    Parameters
    ----------
    chart_mm : Distance of the chart from the sensor.
    mark_px, pitch_px : Width of a mark, and how far apart they are, in focus.
    """
    wished = _BLUR_PITCHES * pitch_px
    nearest = max(
        _NEAREST_PART * chart_mm, _NEAREST_FOCAL_LENGTHS * camera.focal_length_mm
    )
    focus = {
        "in focus": chart_mm,
        "nearer": _focus_mm(camera, chart_mm, nearest, wished),
        "farther": _focus_mm(camera, chart_mm, _FARTHEST_PART * chart_mm, wished),
    }
    takes = []
    for f_number in (camera.f_number, 2 * camera.f_number):
        for name, focus_mm in focus.items():
            blur = blur_mm(camera.focal_length_mm, f_number, focus_mm, chart_mm)
            blur /= camera.pixel_mm
            together = mark_px + blur > pitch_px
            takes.append(FocusTake(name, f_number, focus_mm, blur, together))
    return tuple(takes)


def _focus_mm(
    camera: Camera, chart_mm: float, furthest_mm: float, wished_px: float
) -> float:
    """Focus distance, between the chart's and the furthest, of the wished blur."""

    def blur_px(focus_mm: float) -> float:
        blur = blur_mm(camera.focal_length_mm, camera.f_number, focus_mm, chart_mm)
        return blur / camera.pixel_mm

    if blur_px(furthest_mm) <= wished_px:
        return furthest_mm
    low, high = chart_mm, furthest_mm
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if blur_px(middle) < wished_px else (low, middle)
    return low

"""The camera before a chart: a thin lens that is focused by moving it, and a sensor.

With focal length f and distances D from the sensor, as on the barrel, the lens is
``s = (D + sqrt(D^2 - 4 f D)) / 2`` from what it is focused on, and its magnification is
``m = f / (s - f)``. Focused at S1 from the lens, a point at S2 from it is a disc of
diameter ``|S2 - S1| / S2 * f^2 / (N (S1 - f))``.

All of it follows from ``1/f = 1/s + 1/s'`` with ``D = s + s'`` (W. J. Smith, Modern
Optical Engineering, on image formation).
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

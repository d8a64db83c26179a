"""A lens as another program describes it, before it becomes a preset.

Points are sensor millimetres, origin at the sensor centre, x right, y down. The
undistorted picture is that of a pinhole with the stated principal distance and point.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from lensfit.errors import ExchangeError

Points = Float[np.ndarray, "points 2"]
PointFunction = Callable[[Points], Points]
_ASSUMED_WIDTH_PX = 4096


def assumed_size_px(sensor_mm: tuple[float, float]) -> tuple[int, int]:
    """Width and height of a picture of which neither file nor user says it."""
    width, height = sensor_mm
    return _ASSUMED_WIDTH_PX, max(1, round(_ASSUMED_WIDTH_PX * height / width))


class PointMap(Protocol):
    """Distortion in both directions."""

    def distorted(self, undistorted_mm: Points) -> Points:
        """Where points of the undistorted picture land on the photograph."""
        ...

    def undistorted(self, distorted_mm: Points) -> Points:
        """The inverse; NaN where there is none."""
        ...


class PixelCamera(PointMap, Protocol):
    """A pinhole with distortion that counts in pixels."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the picture."""
        ...

    @property
    def pitch_mm(self) -> float:
        """Of the pixels."""
        ...

    @property
    def principal_distance_mm(self) -> float:
        """Geometric mean of both axes."""
        ...

    @property
    def principal_point_mm(self) -> tuple[float, float]:
        """From the sensor centre."""
        ...


class StatedValues(NamedTuple):
    """What the user knows and the file does not, or what counts in its place.

    Attributes
    ----------
    sensor_width_mm : Width that the picture spans on the sensor.
    focal_length_mm, focus_distance_mm, f_number : Of the lens.
    size_px : Width and height of the picture.
    lens : Part of the name of a lens, or of a node, where a file holds several.
    direction : Of a UV map.
    """

    sensor_width_mm: float | None = None
    focal_length_mm: float | None = None
    focus_distance_mm: float | None = None
    f_number: float | None = None
    size_px: tuple[int, int] | None = None
    lens: str | None = None
    direction: Literal["undistort", "redistort"] | None = None

    def require_size(self, size_px: tuple[int, int], where: str | Path) -> None:
        """Require that no other size is stated than that of a file.

        Raises
        ------
        ExchangeError : One is.
        """
        if self.size_px not in (None, size_px):
            raise ExchangeError(
                f"is for {size_px[0]} x {size_px[1]} pixels, not "
                f"{self.size_px[0]} x {self.size_px[1]}",
                where=where,
                remedy="leave --size out",
            )

    def pitch_mm(self, size_px: tuple[int, int], where: str | Path) -> float:
        """Of the pixels, of a file that does not know the sensor.

        Raises
        ------
        ExchangeError : The sensor width is not stated.
        """
        if self.sensor_width_mm is None:
            raise ExchangeError(
                "counts in pixels and does not know the sensor",
                where=where,
                remedy="give --sensor-width-mm",
            )
        return self.sensor_width_mm / size_px[0]


@dataclass(frozen=True, eq=False)
class ForeignFallOff:
    """Brightness over the photograph, 1 on the axis, at one f-number."""

    f_number: float | None
    illumination: Callable[[Points], Float[np.ndarray, " points"]]


@dataclass(frozen=True, eq=False)
class ForeignState:
    """The lens at one focal length and focus distance.

    Attributes
    ----------
    map : Distortion of green.
    channels : Where "r" and "b" land, of where green lands; empty when unknown.
    focal_length_mm : Nominal, as on the barrel.
    focus_distance_mm : None if not stated.
    entrance_pupil_offset_mm : None if not stated.
    assumed : Names of the values that were not in the file.
    """

    map: PointMap
    principal_distance_mm: float
    principal_point_mm: tuple[float, float]
    focal_length_mm: float
    focus_distance_mm: float | None = None
    entrance_pupil_offset_mm: float | None = None
    channels: Mapping[str, PointFunction] = field(default_factory=dict)
    fall_off: tuple[ForeignFallOff, ...] = ()
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ForeignLens:
    """What a file holds.

    Attributes
    ----------
    source : The format, as people call it.
    sensor_size_mm, size_px : Of the picture.
    states : At least one.
    notes : What its user should know, one sentence each.
    """

    source: str
    name: str
    sensor_size_mm: tuple[float, float]
    size_px: tuple[int, int]
    states: tuple[ForeignState, ...]
    serial: str | None = None
    camera_model: str | None = None
    notes: tuple[str, ...] = ()


def lens_of_camera(
    source: str, camera: PixelCamera, stated: StatedValues, where: str | Path
) -> ForeignLens:
    """The lens of a file that holds one camera and nothing else of it.

    Parameters
    ----------
    source : The format.
    where : The file, which lends its name.
    """
    distance, (width, height) = camera.principal_distance_mm, camera.size_px
    state = ForeignState(
        map=camera,
        principal_distance_mm=distance,
        principal_point_mm=camera.principal_point_mm,
        focal_length_mm=stated.focal_length_mm or distance,
        focus_distance_mm=stated.focus_distance_mm,
    )
    sensor_mm = (width * camera.pitch_mm, height * camera.pitch_mm)
    return ForeignLens(source, Path(where).stem, sensor_mm, camera.size_px, (state,))

"""A lens as another program describes it, before it becomes a preset.

Points are sensor millimetres, origin at the sensor centre, x right, y down. The
undistorted picture is that of a pinhole with the stated principal distance and point.

A map that has a closed form in one direction only is inverted numerically by Newton's
method with central differences, halved where a step does not help, from the target
itself: lens distortion is near the identity. What does not converge, or converges where
the map is folded, is NaN.
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


_STEPS = 60
_DIFFERENCE = 1e-5
_CONVERGED = 1e-12


def inverse_points(
    function: Callable[[Points], Points],
    target: Points,
    unit: float,
) -> Points:
    """The points that `function` takes to `target`.

    Parameters
    ----------
    function : The closed form, row by row.
    unit : Size of the picture in the unit of the points: steps and errors count in it.
    """
    target = np.asarray(target, float)
    points = target.copy()
    with np.errstate(all="ignore"):
        error = function(points) - target
        for _ in range(_STEPS):
            active = ~(_size(error) <= _CONVERGED * unit)
            if not active.any():
                break
            step = np.zeros_like(points)
            step[active] = _newton_step(function, points[active], error[active], unit)
            points, error, moved = _damped_step(function, target, points, error, step)
            if not moved:
                break
        jacobian = _jacobian(function, points, unit)
        good = (_size(error) <= 1e3 * _CONVERGED * unit) & (_det(jacobian) > 0)
    return np.where(good[:, None], points, np.nan)


def is_folded(
    function: Callable[[Points], Points], points: Points, unit: float
) -> bool:
    """Whether the map turns over (or is undefined) at any of the points."""
    with np.errstate(all="ignore"):
        return not bool((_det(_jacobian(function, points, unit)) > 0).all())


def _damped_step(function, target, points, error, step):
    """The step, halved where it makes the error larger; whether anything moved."""
    size, factor = _size(error), np.ones(len(points))
    pending = _size(step) > 0
    moved = False
    for _ in range(12):
        if not pending.any():
            break
        trial = points + step * factor[:, None]
        after = function(trial) - target
        better = pending & (_size(after) < size)
        points = np.where(better[:, None], trial, points)
        error = np.where(better[:, None], after, error)
        moved |= bool(better.any())
        pending &= ~better
        factor = np.where(pending, factor / 2, factor)
    return points, error, moved


def _newton_step(function, points, error, unit) -> np.ndarray:
    jacobian = _jacobian(function, points, unit)
    determinant = _det(jacobian)
    (a, b), (c, d) = jacobian[:, 0].T, jacobian[:, 1].T
    x, y = error.T
    step = -np.stack([d * x - b * y, a * y - c * x], -1) / determinant[:, None]
    longest = np.maximum(_size(step) / (0.5 * unit), 1.0)
    return np.where(np.isfinite(step), step / longest[:, None], 0.0)


def _jacobian(function, points, unit) -> np.ndarray:
    h = _DIFFERENCE * unit
    columns = [
        (function(points + h * axis) - function(points - h * axis)) / (2 * h)
        for axis in np.eye(2)
    ]
    return np.stack(columns, -1)


def _det(jacobian: np.ndarray) -> np.ndarray:
    return jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]


def _size(vectors: np.ndarray) -> np.ndarray:
    """Length; infinite where it is not a number."""
    return np.nan_to_num(np.hypot(vectors[:, 0], vectors[:, 1]), nan=np.inf)

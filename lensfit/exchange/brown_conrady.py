"""The distortion of OpenLensIO: Brown and Conrady's, as a ratio of polynomials.

With x, y in millimetres from the centre of distortion, x right, y down:

    R  = (1 + k1 r^2 + k3 r^4 + k5 r^6) / (1 + k2 r^2 + k4 r^4 + k6 r^6)
    x' = R x + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = R y + 2 p2 x y + p1 (r^2 + 2 y^2)

Odd coefficients are the numerator's, even ones the denominator's; their units are
mm^-2, mm^-4 and mm^-6, that of p1 and p2 is mm^-1. "D-U" leads from distorted to
undistorted, "U-D" back; each is a closed form in its own direction only. Both pictures
share the centre dP + dC: the projection offset and, from it, the distortion offset.

OpenCV's model, a ratio of polynomials too, is fitted to a lens alike. The denominator,
which can have a pole just outside what was fitted, and the thin-prism terms are used
only where they make the residual noticeably smaller.

Source: OpenLensIO 1.0.1, eq. 4 (eq. 8 leaves the "+ dC + dP" out).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar, final

import numpy as np

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
    export_result,
    lens_description,
    principal_point,
    samples_pair,
)
from lensfit.exchange.foreign import PointMap, Points, inverse_points, is_folded
from lensfit.exchange.opencv import OpenCvMap, opencv_distorted, opencv_text
from lensfit.exchange.samples import (
    ExchangeFrame,
    Residual,
    Samples,
    fit_distorting,
    fit_undistorting,
    residual_of,
)
from lensfit.lens import Lens

D_U = "Brown-Conrady D-U"
U_D = "Brown-Conrady U-D"


def brown_conrady(
    points: Points, radial: tuple[float, ...], tangential: tuple[float, ...]
) -> Points:
    """x', y' of the module docstring, about the origin; what is missing is zero."""
    k = np.zeros(6)
    k[: len(radial)] = radial
    p1, p2 = (*tangential, 0.0, 0.0)[:2]
    x, y = points[:, 0], points[:, 1]
    r2 = x * x + y * y
    above = 1 + r2 * (k[0] + r2 * (k[2] + r2 * k[4]))
    below = 1 + r2 * (k[1] + r2 * (k[3] + r2 * k[5]))
    ratio = above / below
    return np.stack(
        [
            ratio * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            ratio * y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
        ],
        -1,
    )


@final
@dataclass(frozen=True, eq=False)
class BrownMap:
    """The model with its numbers.

    Attributes
    ----------
    model : `D_U` or `U_D`.
    radial : k1 ... k6 in the order of OpenLensIO (numerator, denominator, numerator,
        ...), as many as are known.
    tangential : p1, p2, or nothing.
    centre_mm : Of distortion, on the sensor.
    unit_mm : Size of the picture: the inverse is exact to 1e-12 of it.
    """

    model: str
    radial: tuple[float, ...]
    tangential: tuple[float, ...]
    centre_mm: tuple[float, float]
    unit_mm: float

    def undistorted(self, distorted_mm: Points) -> Points:
        """Closed form of "D-U"; NaN where "U-D" has no inverse."""
        if self.model == D_U:
            return self._closed(distorted_mm)
        return inverse_points(self._closed, distorted_mm, self.unit_mm)

    def distorted(self, undistorted_mm: Points) -> Points:
        """Closed form of "U-D"; NaN where "D-U" has no inverse."""
        if self.model == U_D:
            return self._closed(undistorted_mm)
        return inverse_points(self._closed, undistorted_mm, self.unit_mm)

    def _closed(self, points_mm: Points) -> Points:
        centre = np.array(self.centre_mm)
        about = np.asarray(points_mm, float) - centre
        return brown_conrady(about, self.radial, self.tangential) + centre


Made = TypeVar("Made", bound=PointMap)

_WORTH = 0.8
_INVISIBLE_PX = 0.02
"""Worst residual that needs no more coefficients,"""
_EXACT_PX = 1e-6
"""unless they leave none."""
_ROOM = 1.15
"""How far beyond what was fitted a model with a denominator must still be sound."""
_POLYNOMIAL = np.array([0, 2, 4, 6, 7])
_POWERS = np.array([2, 2, 4, 4, 6, 6, 1, 1])
"""Of the radius, for k1 ... k6, p1, p2."""
_OPENCV_NESTED = (
    np.array([0, 1, 2, 3, 4]),
    np.arange(8),
    np.arange(12),
)
_OPENCV_POWERS = np.array([2, 4, 1, 1, 6, 2, 4, 6, 1, 3, 1, 3])


def fit_brown(model: str, samples: Samples, centre_mm: tuple[float, float]) -> BrownMap:
    """OpenLensIO's model in one direction.

    Parameters
    ----------
    model : `brown_conrady.D_U` or `U_D`.
    centre_mm : Of projection and distortion.

    Raises
    ------
    ExchangeError : It turns over inside the frame whatever the coefficients.
    """
    frame, centre = samples.frame, np.array(centre_mm)
    fit = fit_undistorting if model == D_U else fit_distorting
    source = samples.distorted_mm if model == D_U else samples.undistorted_mm
    radius = float(np.linalg.norm(source - centre, axis=-1).max())
    unit = radius ** -_POWERS.astype(float)

    def closed(values: np.ndarray, points: np.ndarray) -> np.ndarray:
        k = values * unit
        return brown_conrady(points - centre, tuple(k[:6]), tuple(k[6:])) + centre

    def made(values: np.ndarray) -> BrownMap:
        k = (values * unit).tolist()
        radial = _without_zeros(k[:6])
        return BrownMap(model, radial, tuple(k[6:]), centre_mm, frame.radius_mm)

    def fitted(used: np.ndarray, start: np.ndarray) -> np.ndarray:
        return _with_used(fit, closed, used, start, samples)

    return _simplest((_POLYNOMIAL, np.arange(8)), fitted, made, samples, 8)


def fit_opencv(
    samples: Samples,
    principal_distance_mm: float,
    principal_point_mm: tuple[float, float],
    squeeze: tuple[float, float],
    most: int = 12,
) -> OpenCvMap:
    """OpenCV's camera: its matrix is the lens' own, the coefficients are fitted.

    Parameters
    ----------
    squeeze : Logarithm of the ratio of the axes times (cos 2a, sin 2a), as in
        `lensfit.optics.distortion`; OpenCV knows the part along x and y.
    most : Coefficients that may be used: 5, 8 or 12.

    Raises
    ------
    ExchangeError : It turns over inside the frame whatever the coefficients.
    """
    frame = samples.frame
    along = np.exp(-squeeze[0] / 2)
    focal_px = principal_distance_mm / frame.pitch_mm
    centre_px = frame.px(np.array([principal_point_mm]))[0] - 0.5
    matrix = np.array(
        [
            [focal_px * along, 0.0, centre_px[0]],
            [0.0, focal_px / along, centre_px[1]],
            [0.0, 0.0, 1.0],
        ]
    )
    directions = (
        samples.undistorted_mm - np.array(principal_point_mm)
    ) / principal_distance_mm
    reach = float(np.linalg.norm(directions, axis=-1).max())
    unit = reach ** -_OPENCV_POWERS.astype(float)
    scale, origin = matrix[[0, 1], [0, 1]], matrix[:2, 2] + 0.5

    def closed(values: np.ndarray, _points: np.ndarray) -> np.ndarray:
        bent = opencv_distorted(directions, np.append(values * unit, [0.0, 0.0]))
        return frame.mm(bent * scale + origin)

    def made(values: np.ndarray) -> OpenCvMap:
        coefficients = np.append(values * unit, [0.0, 0.0])
        return OpenCvMap(matrix, coefficients, frame.size_px, frame.pitch_mm)

    def fitted(used: np.ndarray, start: np.ndarray) -> np.ndarray:
        return _with_used(fit_distorting, closed, used, start, samples)

    nested = tuple(used for used in _OPENCV_NESTED if len(used) <= most)
    return _simplest(nested, fitted, made, samples, 12)


def _with_used(
    fit: Callable,
    closed: Callable,
    used: np.ndarray,
    start: np.ndarray,
    samples: Samples,
) -> np.ndarray:
    def whole(values: np.ndarray) -> np.ndarray:
        found = np.zeros(len(start))
        found[used] = values
        return found

    return whole(fit(lambda v, points: closed(whole(v), points), start[used], samples))


def _simplest(
    nested: tuple[np.ndarray, ...],
    fitted: Callable[[np.ndarray, np.ndarray], np.ndarray],
    made: Callable[[np.ndarray], Made],
    samples: Samples,
    count: int,
) -> Made:
    """The model with the fewest coefficients after which more are not worth it."""
    values, best, least, failure = np.zeros(count), None, None, None
    for used in nested:
        values = fitted(used, values)
        model = made(values)
        try:
            found = residual_of(model, samples)
        except ExchangeError as error:
            failure = error
            continue
        if least is None or (_is_worth(found, least) and _has_room(model, samples)):
            best, least = model, found
        if least.worst_px < _EXACT_PX:
            break
    if best is None:
        assert failure is not None
        raise failure
    return best


def _is_worth(found: Residual, least: Residual) -> bool:
    """Whether more coefficients show, or make the model exact."""
    visible = least.worst_px > _INVISIBLE_PX and found.rms_px < _WORTH * least.rms_px
    return visible or found.worst_px < _EXACT_PX


def _has_room(model: PointMap, samples: Samples) -> bool:
    beyond, radius = samples.undistorted_mm * _ROOM, samples.frame.radius_mm
    return not is_folded(model.distorted, beyond, radius)


def _without_zeros(values: list[float]) -> tuple[float, ...]:
    used = np.flatnonzero(values)
    return tuple(values[: int(used[-1]) + 1]) if len(used) else (0.0,)


def opencv_camera(
    lens: Lens, frame: ExchangeFrame, most: int = 12
) -> tuple[OpenCvMap, Residual]:
    """OpenCV's camera fitted to a lens, and how near it is.

    Parameters
    ----------
    most : Coefficients that may be used.
    """
    fit, judge = samples_pair(lens, frame)
    squeeze = np.asarray(lens.distortion.squeeze).tolist()
    camera = fit_opencv(
        fit,
        float(lens.distortion.principal_distance_mm),
        principal_point(lens),
        (squeeze[0], squeeze[1]),
        most,
    )
    return camera, residual_of(camera, judge)


def export_opencv(request: ExportRequest) -> Exported:
    """An OpenCV calibration in YAML."""
    lens, frame = request.lens(), request.frame
    camera, residual = opencv_camera(lens, frame)
    comments = (
        lens_description(request, lens),
        f"residual {residual} over {frame}",
        f"sensor width {frame.sensor_width_mm!r} mm",
    )
    write_text_atomic(request.out, opencv_text(camera, comments))
    return export_result(request, lens, (Nearness("distortion", residual),))

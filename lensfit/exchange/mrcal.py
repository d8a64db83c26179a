"""mrcal's ``.cameramodel``: OpenCV's cameras and the splined stereographic one.

A file is a Python dictionary of literals with comments: ``lensmodel`` names the model
with its configuration, ``intrinsics`` begin with fx, fy, cx, cy in pixels (integers are
pixel centres, as in OpenCV), ``imagersize`` is the picture. Of LENSMODEL_PINHOLE,
OPENCV4, 5, 8 and 12 the rest are OpenCV's coefficients. For
LENSMODEL_SPLINED_STEREOGRAPHIC, with u the stereographic image 2 xy / (|p| + z) of a
direction p,

    pixel = (u + d(u)) f + c,

d two uniform B-spline surfaces of order 3 or 2 over Nx x Ny control points, centred on
u = 0, so many to a unit of u that the inner ones span ``fov_x_deg``; values of x and y
take turns, row by row.

Splines are fitted to a lens linearly in their control points; those that no sample
reaches are held by a slight preference for surfaces that go on straight. Of OpenCV's
models those of eight and twelve coefficients are written.

Source: mrcal's pages on lens models and splined models.
"""

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np
from jaxtyping import Float

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.exchange.brown_conrady import opencv_camera
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
    export_result,
    lens_description,
    principal_point,
    samples_pair,
)
from lensfit.exchange.foreign import (
    ForeignLens,
    Points,
    StatedValues,
    inverse_points,
    lens_of_camera,
)
from lensfit.exchange.opencv import OpenCvMap
from lensfit.exchange.samples import Residual, Samples, residual_of
from lensfit.exchange.text_file import (
    finite_number,
    picture_size,
    positive_number,
    read_text,
)
from lensfit.lens import Lens

_KIND = "mrcal camera model"
_OPENCV = {"PINHOLE": 0, "OPENCV4": 4, "OPENCV5": 5, "OPENCV8": 8, "OPENCV12": 12}
_SPLINED = re.compile(
    r"SPLINED_STEREOGRAPHIC_order=(\d+)_Nx=(\d+)_Ny=(\d+)_fov_x_deg=(\d+)"
)
_MARGIN = {2: 1, 3: 2}
"""Control points beside those that span the field of view, by order."""
_MOST_CONTROL_POINTS = 100_000


class SplineGrid(NamedTuple):
    """Configuration of the splined model."""

    order: int
    columns: int
    rows: int
    fov_x_deg: int

    @property
    def per_unit(self) -> float:
        """Control points to a unit of u."""
        edge = 2 * math.tan(math.radians(self.fov_x_deg) / 4)
        return (self.columns - 1 - _MARGIN[self.order]) / (2 * edge)

    def shares(self, u: Points) -> tuple[np.ndarray, ...]:
        """Of each direction, the control points that count along x and y, and how much:
        indices (points, order + 1) and shares, for x and then for y."""
        parts = []
        for axis, count in enumerate((self.columns, self.rows)):
            at = u[:, axis] * self.per_unit + (count - 1) / 2
            if self.order == 3:
                first = np.clip(np.trunc(at), 1, count - 3)
                share = _cubic(at - first)
            else:
                first = np.clip(np.trunc(at + 0.5), 1, count - 2)
                share = _quadratic(at - first)
            index = first[:, None].astype(int) - 1 + np.arange(self.order + 1)
            parts += [index, share]
        return tuple(parts)

    def __str__(self) -> str:
        return (
            f"SPLINED_STEREOGRAPHIC_order={self.order}_Nx={self.columns}"
            f"_Ny={self.rows}_fov_x_deg={self.fov_x_deg}"
        )


def _cubic(t: np.ndarray) -> np.ndarray:
    parts = (1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1
    return np.stack([*parts, t**3], -1) / 6


def _quadratic(t: np.ndarray) -> np.ndarray:
    return np.stack([(2 * t - 1) ** 2, 6 - 8 * t**2, (2 * t + 1) ** 2], -1) / 8


@final
@dataclass(frozen=True, eq=False)
class SplinedMap:
    """The splined model over a sensor of known size.

    Attributes
    ----------
    core_px : fx, fy, cx, cy.
    controls : d at the control points.
    """

    core_px: tuple[float, float, float, float]
    grid: SplineGrid
    controls: Float[np.ndarray, "rows columns 2"]
    size_px: tuple[int, int]
    pitch_mm: float

    @property
    def principal_distance_mm(self) -> float:
        """Geometric mean of both axes."""
        return math.sqrt(self.core_px[0] * self.core_px[1]) * self.pitch_mm

    @property
    def principal_point_mm(self) -> tuple[float, float]:
        """From the sensor centre."""
        x, y = self._mm(np.array([self.core_px[2:]]))[0].tolist()
        return x, y

    def distorted(self, undistorted_mm: Points) -> Points:
        """The closed form."""
        about = np.asarray(undistorted_mm, float) - np.array(self.principal_point_mm)
        ahead = np.ones((len(about), 1))
        direction = np.concatenate([about / self.principal_distance_mm, ahead], 1)
        return self._mm(self.pixels(direction))

    def pixels(self, directions: Float[np.ndarray, "points 3"]) -> Points:
        """Where directions land, in pixels whose centres are integers."""
        u = stereographic(directions)
        columns, along, rows, across = self.grid.shares(u)
        near = self.controls[rows[:, :, None], columns[:, None, :]]
        moved = np.einsum("nr,nc,nrck->nk", across, along, near)
        f, c = np.split(np.array(self.core_px), 2)
        return (u + moved) * f + c

    def undistorted(self, distorted_mm: Points) -> Points:
        """The inverse; NaN where there is none."""
        unit = self.pitch_mm * math.hypot(*self.size_px) / 2
        return inverse_points(self.distorted, distorted_mm, unit)

    def _mm(self, pixels: Points) -> Points:
        return (pixels + 0.5 - np.array(self.size_px, float) / 2) * self.pitch_mm


def stereographic(directions: Float[np.ndarray, "points 3"]) -> Points:
    """u of directions; 2 tan of half the angle from the axis long."""
    length = np.linalg.norm(directions, axis=-1, keepdims=True)
    return 2 * directions[:, :2] / (length + directions[:, 2:])


def read_mrcal(path: str | Path, stated: StatedValues) -> ForeignLens:
    """The lens of a camera model.

    Raises
    ------
    ExchangeError : It is no camera model, of a lens model that is not read, or does not
        fit what is stated; or the sensor width is not stated.
    """
    path = Path(path)
    found = _dictionary(path)
    size = picture_size(_numbers(found, "imagersize", path), "imagersize", path)
    stated.require_size(size, path)
    camera = _map(found, size, stated.pitch_mm(size, path), path)
    return lens_of_camera(_KIND, camera, stated, path)


def mrcal_text(camera: OpenCvMap | SplinedMap, comments: tuple[str, ...]) -> str:
    """The camera model as mrcal reads it; the camera stands at the origin."""
    if isinstance(camera, SplinedMap):
        model, core = str(camera.grid), list(camera.core_px)
        numbers = [*core, *camera.controls.ravel().tolist()]
    else:
        (fx, skew, cx), (_, fy, cy), _ = camera.matrix.tolist()
        assert skew == 0
        used = int(np.flatnonzero([1, *camera.coefficients])[-1])
        model, count = next((m, n) for m, n in _OPENCV.items() if n >= used)
        numbers = [fx, fy, cx, cy, *camera.coefficients[:count].tolist()]
    words = ", ".join(repr(float(n)) for n in numbers)
    return "\n".join(
        [
            *(f"# {line}" for line in comments),
            "{",
            f"    'lensmodel': 'LENSMODEL_{model}',",
            "    # fx, fy, cx, cy, then the model's own",
            f"    'intrinsics': [ {words} ],",
            "    'extrinsics': [ 0., 0., 0., 0., 0., 0. ],",
            f"    'imagersize': [ {camera.size_px[0]}, {camera.size_px[1]} ],",
            "}",
            "",
        ]
    )


def _dictionary(path: Path) -> Mapping[str, Any]:
    try:
        found = ast.literal_eval(read_text(path, _KIND).strip())
    except (ValueError, SyntaxError, RecursionError, MemoryError) as error:
        raise ExchangeError(
            "is no dictionary of literals, as mrcal writes", where=path
        ) from error
    if not isinstance(found, dict):
        raise ExchangeError("is no mrcal camera model", where=path)
    return found


def _numbers(found: Mapping[str, Any], key: str, path: Path) -> list[float]:
    values = found.get(key)
    if not isinstance(values, (list, tuple)):
        raise ExchangeError(f"holds no {key}", where=path)
    return [finite_number(value, key, path) for value in values]


def _map(
    found: Mapping[str, Any], size: tuple[int, int], pitch_mm: float, path: Path
) -> OpenCvMap | SplinedMap:
    name = found.get("lensmodel", found.get("lens_model"))
    name = str(name).removeprefix("LENSMODEL_")
    numbers = _numbers(found, "intrinsics", path)
    for value in numbers[:2]:
        positive_number(value, "intrinsics: focal length", path)
    splined = _SPLINED.fullmatch(name)
    if splined is not None:
        grid = _grid(SplineGrid(*map(int, splined.groups())), path)
        _check_count(numbers, 4 + 2 * grid.columns * grid.rows, name, path)
        fx, fy, cx, cy = numbers[:4]
        controls = np.array(numbers[4:]).reshape(grid.rows, grid.columns, 2)
        return SplinedMap((fx, fy, cx, cy), grid, controls, size, pitch_mm)
    if name not in _OPENCV:
        raise ExchangeError(
            f"is of lens model {name[:60]!r}, which is not read",
            where=path,
            remedy="convert it with mrcal-convert-lensmodel to LENSMODEL_OPENCV8 or a "
            "splined stereographic one",
        )
    _check_count(numbers, 4 + _OPENCV[name], name, path)
    fx, fy, cx, cy = numbers[:4]
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    coefficients = np.array([*numbers[4:], *[0.0] * (18 - len(numbers))])
    return OpenCvMap(matrix, coefficients, size, pitch_mm)


def _grid(grid: SplineGrid, path: Path) -> SplineGrid:
    least = grid.order + 1
    good = (
        grid.order in _MARGIN
        and min(grid.columns, grid.rows) >= least
        and grid.columns * grid.rows <= _MOST_CONTROL_POINTS
        and 0 < grid.fov_x_deg < 360
    )
    if not good:
        raise ExchangeError(f"has no splines of {str(grid)[:80]}", where=path)
    return grid


def _check_count(numbers: list[float], count: int, name: str, path: Path) -> None:
    if len(numbers) != count:
        raise ExchangeError(
            f"holds {len(numbers)} intrinsics, and {name[:60]} has {count}", where=path
        )


_COLUMNS = 24
_ROOM = 1.02
_STRAIGHT = 1e-6


def fit_splined(
    samples: Samples,
    principal_distance_mm: float,
    principal_point_mm: tuple[float, float],
) -> SplinedMap:
    """Cubic splines over the samples; the core is the lens' own."""
    frame = samples.frame
    about = samples.undistorted_mm - np.array(principal_point_mm)
    ahead = np.ones((len(about), 1))
    u = stereographic(np.concatenate([about / principal_distance_mm, ahead], 1))
    grid = _control_grid(np.abs(u).max(0))
    f = principal_distance_mm / frame.pitch_mm
    c = frame.px(np.array([principal_point_mm]))[0] - 0.5
    wanted = (frame.px(samples.distorted_mm) - 0.5 - c) / f - u
    controls = _controls(grid, u, wanted)
    core = (f, f, float(c[0]), float(c[1]))
    return SplinedMap(core, grid, controls, frame.size_px, frame.pitch_mm)


def _control_grid(reach: np.ndarray) -> SplineGrid:
    """Columns over the whole width, rows as dense."""
    fov = math.ceil(math.degrees(4 * math.atan(_ROOM * float(reach[0]) / 2)))
    wide = SplineGrid(3, _COLUMNS, 4, fov)
    rows = math.ceil(2 * _ROOM * float(reach[1]) * wide.per_unit) + 3
    return wide._replace(rows=max(rows, 4))


def _controls(grid: SplineGrid, u: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    columns, along, rows, across = grid.shares(u)
    count = grid.columns * grid.rows
    shares = np.zeros((len(u), count))
    index = rows[:, :, None] * grid.columns + columns[:, None, :]
    share = across[:, :, None] * along[:, None, :]
    np.put_along_axis(
        shares, index.reshape(len(u), -1), share.reshape(len(u), -1), axis=1
    )
    bent = _STRAIGHT * _second_differences(grid)
    matrix = np.concatenate([shares, bent])
    target = np.concatenate([wanted, np.zeros((len(bent), 2))])
    found, *_ = np.linalg.lstsq(matrix, target)
    return found.reshape(grid.rows, grid.columns, 2)


def _second_differences(grid: SplineGrid) -> np.ndarray:
    def along(count: int) -> np.ndarray:
        return np.diff(np.eye(count), 2, axis=0)

    in_rows = np.kron(np.eye(grid.rows), along(grid.columns))
    in_columns = np.kron(along(grid.rows), np.eye(grid.columns))
    return np.concatenate([in_rows, in_columns])


_SAMPLES = 81
"""Across the frame; more than control points."""


def export_mrcal_opencv(request: ExportRequest) -> Exported:
    """LENSMODEL_OPENCV8, or as few or many coefficients as are worth it."""
    lens = request.lens()
    return _written(request, lens, *opencv_camera(lens, request.frame))


def export_mrcal_splined(request: ExportRequest) -> Exported:
    """LENSMODEL_SPLINED_STEREOGRAPHIC."""
    lens = request.lens()
    fit, judge = samples_pair(lens, request.frame, _SAMPLES)
    distance = float(lens.distortion.principal_distance_mm)
    made = fit_splined(fit, distance, principal_point(lens))
    return _written(request, lens, made, residual_of(made, judge))


def _written(
    request: ExportRequest,
    lens: Lens,
    camera: OpenCvMap | SplinedMap,
    residual: Residual,
) -> Exported:
    frame = request.frame
    comments = (
        lens_description(request, lens),
        f"residual {residual} over {frame}",
        f"sensor width {frame.sensor_width_mm!r} mm",
    )
    write_text_atomic(request.out, mrcal_text(camera, comments))
    return export_result(request, lens, (Nearness("distortion", residual),))

"""mrcal's splined stereographic model fitted to a lens: linear in its control points.

Control points that no sample reaches are held by a slight preference for surfaces that
go on straight.
"""

import math

import numpy as np

from lensfit.fitting.exchange.samples import Samples
from lensfit.preset.exchange.mrcal import SplinedMap, SplineGrid, stereographic

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
    grid = _grid(np.abs(u).max(0))
    f = principal_distance_mm / frame.pitch_mm
    c = frame.px(np.array([principal_point_mm]))[0] - 0.5
    wanted = (frame.px(samples.distorted_mm) - 0.5 - c) / f - u
    controls = _controls(grid, u, wanted)
    core = (f, f, float(c[0]), float(c[1]))
    return SplinedMap(core, grid, controls, frame.size_px, frame.pitch_mm)


def _grid(reach: np.ndarray) -> SplineGrid:
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

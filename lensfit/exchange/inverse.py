"""The numerical inverse of a map that has a closed form in one direction only.

Newton's method with central differences, halved where a step does not help, from the
target itself: lens distortion is near the identity. What does not converge, or
converges where the map is folded, is NaN.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Points = Float[np.ndarray, "points 2"]

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
            points, error, moved = _damped(function, target, points, error, step)
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


def _damped(function, target, points, error, step):
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

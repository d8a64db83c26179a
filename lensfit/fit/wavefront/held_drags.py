"""Steps of the fit for which drags are known: the shape of dots answers as it can.

Where blur is a pixel wide, orders of coma that undo each other but for a shift look
like nothing: the photographs hardly say what blur drags, and what the model misses of
them says it wrongly. Drags that come from elsewhere are held to a thousandth of a
pixel, like observations in the normal equations of a pass.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensfit.fit.wavefront.drags import drag_slopes_mm, drags_mm, telling_dots
from lensfit.fit.wavefront.gather import Gathered
from lensfit.fit.wavefront.stages import Stage, chi_squared, settled

_HELD_PX = 0.001
_UNDONE = 0.25
"""Share of the squares of drags that may be left of them."""
_ROUNDS = 3
_GREEN = slice(1, 2)


class _Drags(NamedTuple):
    """Of a few dots of every take, in standard deviations."""

    value: Float[np.ndarray, " drags"]
    slopes: Float[np.ndarray, "drags parameters"]


def undoing(stage: Stage, gathered: Gathered) -> Float[np.ndarray, " parameters"]:
    """The move of the parameters that takes all drags away and changes the photographs
    least. No move where drags are too large to undo at one go.
    """
    drags = _drags_of(stage, gathered, _GREEN)
    move = _least_move(stage, drags.slopes, drags.slopes.T @ drags.value)
    undone = replace(stage, parameters=stage.parameters + move)
    left = _drags_of(undone, gathered, _GREEN).value
    fully = np.sum(left**2) < _UNDONE * np.sum(drags.value**2)
    return move if fully else np.zeros_like(move)


def reshaped(stage: Stage, gathered: Gathered) -> Stage:
    """The shape of dots fitted anew while that helps, drags of all channels held."""
    for _ in range(_ROUNDS):
        slopes = _drags_of(stage, gathered, slice(None)).slopes
        move = _least_move(stage, slopes, _slope(stage))
        after = settled(replace(stage, parameters=stage.parameters + move), 1)
        if not _cost(after) < _cost(stage):
            break
        stage = after
    return stage


def _drags_of(stage: Stage, gathered: Gathered, channels: slice) -> _Drags:
    few = telling_dots(gathered)
    pixel_mm = np.array([shown.take.pixel_mm for shown in gathered.shown])[few.take]
    one_mm = _HELD_PX * pixel_mm[:, None]
    value = drags_mm(stage, few)[:, channels] / one_mm
    slopes = drag_slopes_mm(stage, few)[:, channels] / one_mm[..., None]
    return _Drags(value.ravel(), slopes.reshape(value.size, -1))


def _least_move(
    stage: Stage,
    held: Float[np.ndarray, "drags parameters"],
    slope: Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, " parameters"]:
    """Downhill, as a Newton step of all observations, these drags among them."""
    free = np.flatnonzero(stage.deviation > 0)
    matrix = np.asarray(stage.equations.matrix).sum(0) + held.T @ held
    matrix = matrix[np.ix_(free, free)] + np.diag(stage.deviation[free] ** -2.0)
    move = np.zeros(stage.layout.size)
    move[free] = -np.linalg.solve(matrix, slope[free])
    return move


def _slope(stage: Stage) -> Float[np.ndarray, " parameters"]:
    """Half the gradient of what a solve minimises."""
    off = stage.parameters - stage.mean
    return np.asarray(stage.equations.gradient).sum(0) + _precision(stage) * off


def _cost(stage: Stage) -> float:
    off = stage.parameters - stage.mean
    return chi_squared(stage) + float(_precision(stage) @ off**2)


def _precision(stage: Stage) -> Float[np.ndarray, " parameters"]:
    """Of the priors; zero for fixed parameters."""
    return np.where(stage.deviation > 0, stage.deviation, np.inf) ** -2.0

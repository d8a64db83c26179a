"""Steps of the fit with centroid biases fixed: the shape of dots is fitted within that.

Where blur is a pixel wide, orders of coma that undo each other but for a shift look
like nothing: from the photographs the bias follows weakly, and wrongly by what the
model misses of them. Biases that come from elsewhere are fixed to a thousandth of a
pixel, as observations in the normal equations of a pass.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.fitting.wavefront.centroid_biases import (
    centroid_bias_slopes_mm,
    centroid_biases_mm,
    sampled_dots,
)
from lensfit.fitting.wavefront.gather import Gathered
from lensfit.fitting.wavefront.stages import Stage, chi_squared, settled

_HELD_PX = 0.001
_UNDONE = 0.25
"""Share of the squares of biases that may be left of them."""
_ROUNDS = 3
_GREEN, _ALL = slice(1, 2), slice(None)


def undoing(stage: Stage, gathered: Gathered) -> Float[np.ndarray, " parameters"]:
    """The move of the parameters that takes green's biases away, to first order, and
    changes the photographs least. No move where they are too large for that.
    """
    few = sampled_dots(gathered)
    slopes, value = _slopes(stage, few, _GREEN), _value(stage, few, _GREEN)
    move = _least_move(stage, slopes, slopes.T @ value)
    undone = replace(stage, parameters=stage.parameters + move)
    left = _value(undone, few, _GREEN)
    fully = np.sum(left**2) < _UNDONE * np.sum(value**2)
    return move if fully else np.zeros_like(move)


def reshaped(stage: Stage, gathered: Gathered) -> Stage:
    """The shape of dots fitted anew while that helps, the biases of all channels fixed
    where they are."""
    few = sampled_dots(gathered)
    held = _value(stage, few, _ALL)
    off, cost = np.zeros_like(held), _cost(stage)
    for _ in range(_ROUNDS):
        slopes = _slopes(stage, few, _ALL)
        move = _least_move(stage, slopes, stage.slope + slopes.T @ off)
        after = settled(replace(stage, parameters=stage.parameters + move))
        off = _value(after, few, _ALL) - held
        cost_after = _cost(after) + float(np.sum(off**2))
        if not cost_after < cost:
            break
        stage, cost = after, cost_after
    return stage


def _value(
    stage: Stage, few: Gathered, channels: slice
) -> Float[np.ndarray, " biases"]:
    """Biases in units of `_HELD_PX`."""
    return (centroid_biases_mm(stage, few)[:, channels] / _unit_mm(few)).ravel()


def _slopes(
    stage: Stage, few: Gathered, channels: slice
) -> Float[np.ndarray, "biases parameters"]:
    """d `_value` / d parameter."""
    slopes = centroid_bias_slopes_mm(stage, few)[:, channels] / _unit_mm(few)[..., None]
    return slopes.reshape(-1, slopes.shape[-1])


def _unit_mm(few: Gathered) -> Float[np.ndarray, "dots 1 2"]:
    pixel_mm = np.array([shown.take.pixel_mm for shown in few.shown])
    return _HELD_PX * pixel_mm[few.take][:, None]


def _least_move(
    stage: Stage,
    held: Float[np.ndarray, "biases parameters"],
    slope: Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, " parameters"]:
    """A Gauss-Newton step of all observations, biases of these slopes among them.

    Parameters
    ----------
    slope : Half the gradient.
    """
    free = np.flatnonzero(stage.deviation > 0)
    matrix = np.asarray(stage.equations.matrix).sum(0) + held.T @ held
    matrix = matrix[np.ix_(free, free)]
    matrix = matrix + stage.prior_matrix(free, stage.deviation[free])
    move = np.zeros(stage.layout.size)
    move[free] = -np.linalg.solve(matrix, slope[free])
    return move


def _cost(stage: Stage) -> float:
    off = stage.parameters - stage.mean
    stated = stage.stated_equations.sum_of_squares
    return chi_squared(stage) + stated + float(stage.precision @ off**2)

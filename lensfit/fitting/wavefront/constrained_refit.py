"""Steps of the fit with centroid biases fixed: a constrained refit of the dots' shape.

Where blur is a pixel wide, orders of coma that cancel each other but for a shift barely
change the image. The photographs then determine the bias only weakly, and with an
error due to what the model misses. Here the biases are known from elsewhere. They are
fixed to a thousandth of a pixel, as observations in the normal equations.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensfit.fitting.wavefront.centroid_biases import (
    centroid_bias_slopes_mm,
    centroid_biases_mm,
    sampled_dots,
)
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.fitting.wavefront.stages import Stage, chi_squared, recentre_patches

_BIAS_TOLERANCE_PX = 0.001
_LARGEST_SHARE_LEFT = 0.25
"""Largest share of the sum of squared biases that may remain."""
_ROUNDS = 3
_GREEN_ALONE, _ALL_CHANNELS = slice(1, 2), slice(None)


def bias_cancelling_move(
    stage: Stage, dot_data: DotData
) -> Float[np.ndarray, " parameters"]:
    """The move of the parameters that cancels green's biases, to first order, and
    changes the photographs least. Zero where they are too large for that.
    """
    few = sampled_dots(dot_data)
    slopes, value = _slopes(stage, few, _GREEN_ALONE), _value(stage, few, _GREEN_ALONE)
    move = _least_move(stage, slopes, slopes.T @ value)
    undone = replace(stage, parameters=stage.parameters + move)
    left = _value(undone, few, _GREEN_ALONE)
    fully = np.sum(left**2) < _LARGEST_SHARE_LEFT * np.sum(value**2)
    return move if fully else np.zeros_like(move)


def refit_with_fixed_biases(stage: Stage, dot_data: DotData) -> Stage:
    """The shape of dots fitted again while the cost falls, with the centroid biases of
    all channels fixed at their present values."""
    few = sampled_dots(dot_data)
    held = _value(stage, few, _ALL_CHANNELS)
    off, cost = np.zeros_like(held), _cost(stage)
    for _ in range(_ROUNDS):
        slopes = _slopes(stage, few, _ALL_CHANNELS)
        move = _least_move(stage, slopes, stage.slope + slopes.T @ off)
        after = recentre_patches(replace(stage, parameters=stage.parameters + move))
        off = _value(after, few, _ALL_CHANNELS) - held
        cost_after = _cost(after) + float(np.sum(off**2))
        if not cost_after < cost:
            break
        stage, cost = after, cost_after
    return stage


def _value(stage: Stage, few: DotData, channels: slice) -> Float[np.ndarray, " biases"]:
    """Biases in units of `_BIAS_TOLERANCE_PX`."""
    return (centroid_biases_mm(stage, few)[:, channels] / _unit_mm(few)).ravel()


def _slopes(
    stage: Stage, few: DotData, channels: slice
) -> Float[np.ndarray, "biases parameters"]:
    """d `_value` / d parameter."""
    slopes = centroid_bias_slopes_mm(stage, few)[:, channels] / _unit_mm(few)[..., None]
    return slopes.reshape(-1, slopes.shape[-1])


def _unit_mm(few: DotData) -> Float[np.ndarray, "dots 1 2"]:
    pixel_mm = np.array([photograph.take.pixel_mm for photograph in few.photographs])
    return _BIAS_TOLERANCE_PX * pixel_mm[few.take][:, None]


def _least_move(
    stage: Stage,
    held: Float[np.ndarray, "biases parameters"],
    slope: Float[np.ndarray, " parameters"],
) -> Float[np.ndarray, " parameters"]:
    """A Gauss-Newton step with biases of these slopes as further observations.

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

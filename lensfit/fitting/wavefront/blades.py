"""How many blades the iris has, from the shape of defocused dots.

The edge of a defocused dot near the axis is the edge of the pupil. For every number of
blades the corners are rotated to where they fit the photographs best. The number of
blades with the smallest misfit is kept if it is clearly better than a round iris.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Int

from lensfit.fitting.wavefront.dot_data import WIDE_OPEN, select_dots
from lensfit.fitting.wavefront.stages import (
    Stage,
    best_of,
    chi_squared,
    set_priors,
    smooth_stage,
    solve_stage,
)

BLADE_COUNTS = (5, 6, 7, 8, 9, 10, 11, 12)
_TURNS = 3
_DOTS = 16
_FINALISTS = 3
FINAL_MISFIT_SHARE, EARLY_MISFIT_SHARE = 0.95, 0.8
"""Largest misfit with blades over that of a round iris: where all the rest is fitted,
and before that."""
_SMOOTHING = 0.8
_DEVIATION = (3.0, 1.0)


def fit_blades(stage: Stage, share: float = FINAL_MISFIT_SHARE) -> Stage:
    """The same with the number and rotation of blades that fit the photographs best.

    Parameters
    ----------
    share : Largest misfit with blades over that of a round iris.
    """
    rows = _iris_rows(stage)
    if not len(rows):
        return stage
    where = stage.layout.blocks["iris"]
    rotation, curvature = where.start + 1, where.start + 2
    deviation = np.zeros(stage.layout.size)
    deviation[[rotation, curvature]] = _DEVIATION
    some = replace(
        stage,
        dot_data=select_dots(stage.dot_data, rows),
        corner_mm=stage.corner_mm[rows],
        weight=stage.weight[rows],
    )
    some = set_priors(smooth_stage(some, _SMOOTHING), deviation)
    turned = [
        best_of(_rotation_trials(some, count, rotation)) for count in BLADE_COUNTS
    ]
    turned.sort(key=chi_squared)
    best = best_of([solve_stage(trial, 6) for trial in turned[:_FINALISTS]])
    if chi_squared(best) > share * chi_squared(solve_stage(some, 1)):
        return stage
    iris = best.parameters[where].copy()
    iris[1] = np.mod(iris[1], 2 * np.pi / best.blades)
    parameters, mean = stage.parameters.copy(), stage.mean.copy()
    parameters[where] = mean[where] = iris
    return replace(stage, parameters=parameters, mean=mean, blades=best.blades)


def _rotation_trials(stage: Stage, count: int, rotation: int) -> list[Stage]:
    """One pass for each of a few rotations of the corners."""
    found = []
    for turn in range(_TURNS):
        parameters = stage.parameters.copy()
        parameters[rotation] = 2 * np.pi / count * turn / _TURNS
        found.append(
            solve_stage(replace(stage, blades=count, parameters=parameters), 1)
        )
    return found


def _iris_rows(stage: Stage) -> Int[np.ndarray, " rows"]:
    """Dots that show the iris: stopped down, most defocused, nearest the axis."""
    dot_data = stage.dot_data
    stopped = dot_data.dots.stop_radius < 1 / WIDE_OPEN
    if not stopped.any():
        return np.array([], int)
    defocus = np.abs(stage.parameters[stage.layout.blocks["defocus"]])
    size = defocus[dot_data.dots.group] * dot_data.dots.stop_radius
    size = size / dot_data.dots.cell_mm[:, 0]
    size = np.where(stopped, size, 0.0)
    blurred = np.flatnonzero(size > 0.5 * size.max())
    radius = np.hypot(*dot_data.dots.field_mm[blurred].T)
    return np.sort(blurred[np.argsort(radius)[:_DOTS]])

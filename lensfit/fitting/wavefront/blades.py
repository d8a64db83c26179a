"""How many blades the iris has, from the shape of defocused dots.

The edge of a defocused dot near the axis is the opening's edge. For every number of
blades the corners are turned to where they suit the photographs best, and the number
that leaves least is kept, if it beats a round opening clearly.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Int

from lensfit.fitting.wavefront.gather import WIDE_OPEN, chosen
from lensfit.fitting.wavefront.stages import (
    Stage,
    best_of,
    chi_squared,
    freed,
    smoothed_by,
    solved,
)

COUNTS = (5, 6, 7, 8, 9, 10, 11, 12)
_TURNS = 3
_DOTS = 16
_FINALISTS = 3
CLEARLY, EVIDENTLY = 0.95, 0.8
"""What blades must leave of what a round opening does not explain: where all the rest
is fitted, and before that."""
_SMOOTHING = 0.8
_DEVIATION = (3.0, 1.0)


def with_blades(stage: Stage, share: float = CLEARLY) -> Stage:
    """The same with the blades that the photographs show, turned as they are.

    Parameters
    ----------
    share : Of the misfit of a round opening that blades may leave at most.
    """
    rows = _telling(stage)
    if not len(rows):
        return stage
    where = stage.layout.blocks["iris"]
    rotation, curvature = where.start + 1, where.start + 2
    deviation = np.zeros(stage.layout.size)
    deviation[[rotation, curvature]] = _DEVIATION
    some = replace(
        stage,
        gathered=chosen(stage.gathered, rows),
        corner_mm=stage.corner_mm[rows],
        weight=stage.weight[rows],
    )
    some = freed(smoothed_by(some, _SMOOTHING), deviation)
    turned = [best_of(_turned(some, count, rotation)) for count in COUNTS]
    turned.sort(key=chi_squared)
    best = best_of([solved(trial, 6) for trial in turned[:_FINALISTS]])
    if chi_squared(best) > share * chi_squared(solved(some, 1)):
        return stage
    iris = best.parameters[where].copy()
    iris[1] = np.mod(iris[1], 2 * np.pi / best.blades)
    parameters, mean = stage.parameters.copy(), stage.mean.copy()
    parameters[where] = mean[where] = iris
    return replace(stage, parameters=parameters, mean=mean, blades=best.blades)


def _turned(stage: Stage, count: int, rotation: int) -> list[Stage]:
    """One pass for each of a few turns of the corners."""
    found = []
    for turn in range(_TURNS):
        parameters = stage.parameters.copy()
        parameters[rotation] = 2 * np.pi / count * turn / _TURNS
        found.append(solved(replace(stage, blades=count, parameters=parameters), 1))
    return found


def _telling(stage: Stage) -> Int[np.ndarray, " rows"]:
    """Dots that show the iris: stopped down, most defocused, nearest the axis."""
    gathered = stage.gathered
    stopped = gathered.dots.stop_radius < 1 / WIDE_OPEN
    if not stopped.any():
        return np.array([], int)
    defocus = np.abs(stage.parameters[stage.layout.blocks["defocus"]])
    size = defocus[gathered.dots.group] * gathered.dots.stop_radius
    size = size / gathered.dots.cell_mm[:, 0]
    size = np.where(stopped, size, 0.0)
    blurred = np.flatnonzero(size > 0.5 * size.max())
    radius = np.hypot(*gathered.dots.field_mm[blurred].T)
    return np.sort(blurred[np.argsort(radius)[:_DOTS]])

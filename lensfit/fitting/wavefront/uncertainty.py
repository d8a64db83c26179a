"""How well the wavefront's parameters are known.

The covariance is the sandwich estimate over dots: normal equations on the outside, the
scatter of every dot's own gradient inside. So it holds whatever the noise of a cell was
taken for, and counts what the model misses of a dot, in all its channels, as one error,
not as many. It says by how much the fit would change with other dots: the errors of the
model are in it, which no other noise would show. A solve that ended before its minimum
had so far to go: that counts as one error more.

A lean model is surer than it should be: what it leaves out is not known to be nothing.
So in what is stated, families that were left out for want of evidence count as free,
each within its prior, and what the fit would move by if they were is one error with the
rest. And what no dot shows is added, as in `fit.systematic`: all parameters are taken
to be off together by as much as changes the images of dots by `SYSTEMATIC`.

Reference: on lean models, the documentation of mrcal on projection uncertainty; P. J.
Huber, Proc. Fifth Berkeley Symposium 1 (1967) 221; over groups, with
the factor for few of them, A. C. Cameron and D. L. Miller, J. Human Resources 50 (2015)
317.
"""

import numpy as np
from jaxtyping import Float, Int

from lensfit.fitting.systematic import covariance_nearest, systematic_covariance
from lensfit.fitting.wavefront.stages import Stage
from lensfit.fitting.wavefront.term_group_selection import CELLS_PER_DOT
from lensfit.fitting.wavefront.term_groups import (
    LAST,
    Family,
    deviation_of,
    indices_of,
)

SYSTEMATIC = 0.008
"""Share of a dot's image, in L2. With it the errors of point-spread functions that are
expected of traced lenses are about those found; without it a third to a half."""
KEPT = 0.999
"""Share of the variance in the photographs that moves carry."""
_ROUNDING = 1e-13
"""Of the largest precision: less, or less than none, is what rounding leaves."""
UNSEEN = 0.7
"""A parameter whose deviation is this share of its prior's is not seen."""


def covariance_of(
    stage: Stage, families: tuple[Family, ...]
) -> Float[np.ndarray, "parameters parameters"]:
    """Of all parameters; zero rows for those that were fixed."""
    free = indices_of(families)
    square = np.ix_(free, free)
    prior = stage.prior_matrix(free, deviation_of(families, stage.layout, LAST)[free])
    matrix = np.asarray(stage.equations.matrix.sum(0))[square]
    assert stage.solution is not None
    of_channels = np.asarray(stage.solution.per_dot.gradient)
    each = of_channels.sum(1)[:, free]
    each = each[np.any(each != 0, -1)]
    scatter = each.T @ each * _small_sample(len(each), stage, len(free))
    # What the prior holds has the prior's own scatter.
    inverse = np.linalg.inv(matrix + prior)
    covariance = np.zeros((stage.layout.size,) * 2)
    inside = inverse @ (scatter + prior) @ inverse
    # Where the solve ended it had this far to go.
    left = inverse @ stage.slope[free]
    covariance[square] = (inside + inside.T) / 2 + np.outer(left, left)
    return covariance


def unshown_covariance_of(
    stage: Stage,
    families: tuple[Family, ...],
    covariance: Float[np.ndarray, "parameters parameters"],
) -> Float[np.ndarray, "parameters parameters"]:
    """What is stated to others beyond `covariance`: of what a lean model leaves out,
    of stops whose radius no dot shows, and of errors that no dot shows.

    More freedom may make a sandwich smaller in some direction; what was stated stays
    there, so that this is a covariance too.

    Parameters
    ----------
    families : All that might be free, whether the fit kept them or not.
    covariance : `covariance_of` what is free.
    """
    free = indices_of(families)
    square = np.ix_(free, free)
    larger = covariance_of(stage, families)
    larger[square] += _systematic(
        stage,
        np.asarray(stage.equations.matrix.sum(0))[square],
        deviation_of(families, stage.layout, LAST)[free] ** -2.0,
    )
    held = held_stops(stage, free)
    larger[held, held] += stage.gathered.widths.f_number**2
    return covariance_nearest(larger - covariance, np.sqrt(np.diag(larger)))


def held_stops(
    stage: Stage, free: Int[np.ndarray, " free"]
) -> Int[np.ndarray, " stops"]:
    """Ratios of stops that no dot shows: they are what the f-number says."""
    first = stage.layout.blocks["stop_ratio"].start
    every = first + np.arange(len(stage.gathered.f_numbers) - 1)
    return np.setdiff1d(every, free)


def _systematic(
    stage: Stage,
    matrix: Float[np.ndarray, "free free"],
    precision: Float[np.ndarray, " free"],
) -> Float[np.ndarray, "free free"]:
    """Covariance of parameters that together change dots' images by `SYSTEMATIC`."""
    background = stage.nuisance[..., 1, None, None]
    modelled = stage.gathered.light - stage.residual - background
    explained = SYSTEMATIC**2 * float(np.sum(stage.weight * modelled**2))
    return systematic_covariance(matrix, precision, explained)


def _small_sample(dots: int, stage: Stage, free: int) -> float:
    """G/(G - 1) (N - 1)/(N - k), of G dots with N observations in all."""
    seen = CELLS_PER_DOT * int(np.sum(np.any(stage.weight > 0, (-2, -1))))
    return dots / max(dots - 1, 1) * (seen - 1) / max(seen - free, 1)


def parameter_moves(
    stage: Stage, covariance: Float[np.ndarray, "parameters parameters"]
) -> Float[np.ndarray, "moves parameters"]:
    """Independent moves of all parameters by one standard deviation each.

    Their outer products sum to the covariance. They come in the order of what they
    change in the photographs, in the weights and priors of the fit, and end where the
    rest is a thousandth of the variance there.
    """
    free = np.flatnonzero(np.diag(covariance) > 0)
    if not len(free):
        return np.zeros((0, len(covariance)))
    square = np.ix_(free, free)
    # What the fit left out has no prior there: its own deviation stands for it.
    own = np.sqrt(np.diag(covariance)[free])
    deviation = np.where(stage.deviation[free] > 0, stage.deviation[free], own)
    matrix = np.asarray(stage.equations.matrix.sum(0))[square]
    # In own deviations, since they differ by many orders.
    scale = np.outer(own, own)
    prior = stage.prior_matrix(free, deviation)
    known, turned = np.linalg.eigh((matrix + prior) * scale)
    size = np.sqrt(np.maximum(known, _ROUNDING * known[-1]))
    root = turned * size
    variance, axes = np.linalg.eigh(root.T @ (covariance[square] / scale) @ root)
    variance, axes = np.clip(variance[::-1], 0.0, None), axes[:, ::-1]
    share = np.cumsum(variance) / variance.sum()
    count = min(int(np.searchsorted(share, KEPT)) + 1, len(free))
    moves = np.zeros((count, len(covariance)))
    along = turned / size @ (axes[:, :count] * np.sqrt(variance[:count]))
    moves[:, free] = along.T * own
    return moves


def unseen(
    stage: Stage, families: tuple[Family, ...], covariance: np.ndarray
) -> tuple[str, ...]:
    """Families of which the photographs say hardly more than the prior did."""
    deviation = np.sqrt(np.clip(np.diag(covariance), 0, None))
    names = []
    for family in families:
        share = deviation[list(family.indices)] / np.asarray(family.deviation)
        if np.median(share) > UNSEEN:
            names.append(family.name)
    return tuple(names)

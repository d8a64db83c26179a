"""How well the wavefront's parameters are known.

The covariance is the sandwich estimate over dots: inverse normal equations on the
outside, the scatter of every dot's own gradient inside. So it does not depend on the
noise assumed for a cell, and the model's error of a dot, in all its channels, counts as
one error, not as many. It gives how much the fit would change with other dots, errors
of the model included, which pixel noise alone would not show. If a solve ended before
its minimum, the remaining step counts as one error more.

A lean model is too certain: what it leaves out is not known to be zero. So in the
reported covariance, term groups that model selection left out count as free, each
within its prior, and the step that the fit would take if they were is one error with
the rest. Errors that no dot shows are added, as in `fitting.systematic`: what a model
misses is partly visible in the residuals, beyond the noise, and partly absorbed by its
parameters. All of these are taken to be off together by what changes the images of dots
as much as the visible part does. Along edges most of what is visible is no error of the
lens, but ink, uneven light, and what JPEG left: there, and where detected points are
placed, a constant share takes its place.

Reference: on lean models, the documentation of mrcal on projection uncertainty; P. J.
Huber, Proc. Fifth Berkeley Symposium 1 (1967) 221; over groups, with
the factor for few of them, A. C. Cameron and D. L. Miller, J. Human Resources 50 (2015)
317.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensfit.fitting.systematic import covariance_nearest, systematic_covariance
from lensfit.fitting.wavefront.dot_arrays import show_edges
from lensfit.fitting.wavefront.dot_weights import missed_factor, noise_variances
from lensfit.fitting.wavefront.stages import Stage
from lensfit.fitting.wavefront.term_group_selection import CELLS_PER_DOT
from lensfit.fitting.wavefront.term_groups import (
    LAST,
    TermGroup,
    deviation_of,
    indices_of,
)

MOVES_POINTS = 0.008
"""Share of a dot's image, in L2, that the model misses and that moves its detected
point. Most of what a model visibly misses leaves the point where it is: with all of it
a noisy shoot would not know its entrance pupil. With this constant the errors of chief
rays of traced lenses are about those stated."""
_LEAST_MISSED = 0.006
"""Share of a dot's image, in L2, that the model misses at least: what its rays do."""
KEPT = 0.999
"""Share of the variance in the photographs that `parameter_moves` covers."""
_ROUNDING = 1e-13
"""Of the largest precision: smaller or negative eigenvalues are rounding errors."""
UNDETERMINED_SHARE = 0.7
"""A parameter whose deviation exceeds this share of its prior's is undetermined."""


def covariance_of(
    stage: Stage, term_groups: tuple[TermGroup, ...]
) -> Float[np.ndarray, "parameters parameters"]:
    """Of all parameters; zero rows for those that were fixed."""
    free = indices_of(term_groups)
    square = np.ix_(free, free)
    prior = stage.prior_matrix(
        free, deviation_of(term_groups, stage.layout, LAST)[free]
    )
    matrix = stage.matrix_of_dots(free)
    assert stage.solution is not None
    of_channels = np.asarray(stage.solution.per_dot.gradient)
    each = of_channels.sum(1)[:, free]
    each = each[np.any(each != 0, -1)]
    scatter = each.T @ each * _small_sample(len(each), stage, len(free))
    # The part that the prior determines has the prior's own scatter.
    inverse = np.linalg.inv(matrix + prior)
    covariance = np.zeros((stage.layout.size,) * 2)
    inside = inverse @ (scatter + prior) @ inverse
    # The remaining Newton step where the solve ended.
    left = inverse @ stage.slope[free]
    covariance[square] = (inside + inside.T) / 2 + np.outer(left, left)
    return covariance


class ModelErrors(NamedTuple):
    """What is added to the covariance of what is free: for what a lean model leaves
    out, for stops whose radius no dot determines, and for errors that no dot shows.

    Attributes
    ----------
    of_blur : In reports and point-spread functions.
    of_points : Where detected points are placed (`MOVES_POINTS`).
    """

    of_blur: Float[np.ndarray, "parameters parameters"]
    of_points: Float[np.ndarray, "parameters parameters"]


def model_errors_of(
    stage: Stage,
    term_groups: tuple[TermGroup, ...],
    covariance: Float[np.ndarray, "parameters parameters"],
) -> ModelErrors:
    """What is added to `covariance`.

    More freedom may make a sandwich smaller in some direction; there nothing is
    subtracted, so that these are covariances too.

    Parameters
    ----------
    term_groups : All that might be free, whether the fit kept them or not.
    covariance : `covariance_of` what is free.
    """
    free = indices_of(term_groups)
    square = np.ix_(free, free)
    matrix = stage.matrix_of_dots(free)
    precision = deviation_of(term_groups, stage.layout, LAST)[free] ** -2.0
    freer = covariance_of(stage, term_groups)
    held = fixed_stop_ratios(stage, free)
    freer[held, held] += stage.dot_data.widths.f_number**2

    def added(explained: float) -> Float[np.ndarray, "parameters parameters"]:
        larger = freer.copy()
        larger[square] += systematic_covariance(matrix, precision, explained)
        return covariance_nearest(larger - covariance, np.sqrt(np.diag(larger)))

    whole, visible = _chi_squared_of_images(stage)
    return ModelErrors(
        of_blur=added(max(visible, _LEAST_MISSED**2 * whole)),
        of_points=added(MOVES_POINTS**2 * whole),
    )


def fixed_stop_ratios(
    stage: Stage, free: Int[np.ndarray, " free"]
) -> Int[np.ndarray, " stops"]:
    """Ratios of stops that no dot determines: their f-numbers are taken as they are."""
    first = stage.layout.blocks["stop_ratio"].start
    every = first + np.arange(len(stage.dot_data.f_numbers) - 1)
    return np.setdiff1d(every, free)


def _chi_squared_of_images(stage: Stage) -> tuple[float, float]:
    """Of the whole images of all dots, edges as `missed_factor` has them, and of what
    the model visibly misses of those that are no edges, beyond the noise."""
    background = stage.nuisance[..., 1]
    modelled = stage.dot_data.light - stage.residual - background[..., None, None]
    noise = noise_variances(stage.dot_data, stage.residual, background)
    factor = missed_factor(stage.dot_data)[:, None, None, None]
    whole = np.sum(stage.weight * (factor * modelled) ** 2)
    missed = stage.weight * (stage.residual**2 - noise)
    visible = np.sum(missed[~show_edges(stage.dot_data.dots)])
    return float(whole), float(visible)


def _small_sample(dots: int, stage: Stage, free: int) -> float:
    """G/(G - 1) (N - 1)/(N - k), of G dots with N observations in all."""
    seen = CELLS_PER_DOT * int(np.sum(np.any(stage.weight > 0, (-2, -1))))
    return dots / max(dots - 1, 1) * (seen - 1) / max(seen - free, 1)


def parameter_moves(
    stage: Stage, covariance: Float[np.ndarray, "parameters parameters"]
) -> Float[np.ndarray, "moves parameters"]:
    """Independent moves of all parameters by one standard deviation each.

    Their outer products sum to the covariance. They are ordered by how much they
    change the photographs, in the weights and priors of the fit, and end where the
    rest is a thousandth of the variance there.
    """
    free = np.flatnonzero(np.diag(covariance) > 0)
    if not len(free):
        return np.zeros((0, len(covariance)))
    square = np.ix_(free, free)
    # Parameters that the fit left out have no prior: their own deviation is used.
    own = np.sqrt(np.diag(covariance)[free])
    deviation = np.where(stage.deviation[free] > 0, stage.deviation[free], own)
    matrix = stage.matrix_of_dots(free)
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


def undetermined_term_groups(
    stage: Stage, term_groups: tuple[TermGroup, ...], covariance: np.ndarray
) -> tuple[str, ...]:
    """Term groups whose deviations are about as large as the prior's."""
    deviation = np.sqrt(np.clip(np.diag(covariance), 0, None))
    names = []
    for term_group in term_groups:
        share = deviation[list(term_group.indices)] / np.asarray(term_group.deviation)
        if np.median(share) > UNDETERMINED_SHARE:
            names.append(term_group.name)
    return tuple(names)

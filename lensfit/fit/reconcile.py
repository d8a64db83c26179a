"""What marks say of the wavefront that moved them.

The shape of a dot tells coma badly where blur is a pixel wide: orders of coma that undo
each other but for a shift look like nothing, and take marks along by half a pixel. But
marks of one flat chart lie on one smooth map, at every f-number and on both sides of
focus: an error of the wavefront that puts them elsewhere, here and there differently,
shows in what the map leaves of them. So amounts of the wavefront's independent errors
are found that, with the map's own parameters, leave least of all marks, each amount
expected to be within its standard deviation. Poses and distortion go along, so that
nothing is taken from them that they can explain; what errors of the wavefront and the
map explain alike stays as unsure as it was.

Linear, about the fit to centroids: marks move by tenths of a pixel.

Reference: C. R. Henderson, Biometrics 31 (1975) 423, on fixed and random effects
together; eliminating the former, B. Triggs et al., Bundle adjustment (2000), section 6.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensfit.fit.adjust import Adjustment, weigh_residual
from lensfit.fit.lens_state import LensState
from lensfit.fit.take import Take
from lensfit.fit.views import observed_of, whitening_of

_GREEN = 1
_ROUNDS = 3
"""Of weights, each for what the one before left."""
_STEP = 0.1
"""Of differences, standard deviations of the parameter."""


class Amounts(NamedTuple):
    """Of the wavefront's errors, in the order of `shared_moves_mm`.

    Attributes
    ----------
    value : In standard deviations.
    covariance : What the marks leave open; 1 for each where they say nothing.
    """

    value: Float[np.ndarray, " moves"]
    covariance: Float[np.ndarray, "moves moves"]


def amounts_of(states: Sequence[LensState], moved: Sequence[Take]) -> Amounts:
    """How large the errors were that moved the marks.

    Parameters
    ----------
    states : Fitted to centroids.
    moved : Takes of these states with marks at the chief rays, whose `shared_moves_mm`
        are one list of errors for all.
    """
    by_name = {take.name: take for take in moved}
    every = [_state_of(state, by_name) for state in states]
    each = [one for one in every if len(one.moves_mm)]
    count = max((len(one.moves_mm) for one in each), default=0)
    found = Amounts(np.zeros(count), np.eye(count))
    for _ in range(_ROUNDS):
        said = [_equations_of(one, found.value) for one in each]
        matrix = sum((one.matrix for one in said), np.eye(count))
        towards = sum((one.towards for one in said), np.zeros(count))
        covariance = np.linalg.inv(matrix)
        found = Amounts(covariance @ towards, covariance)
    return found


class _State(NamedTuple):
    """One state, linear about its fit.

    Attributes
    ----------
    residual_mm : Predicted less observed, the observed ones moved.
    slopes_mm : d predicted / d free parameter, of one standard deviation.
    moves_mm : How observed marks go with each error of the wavefront.
    pull, hold : Gradient and matrix of the priors of the free parameters.
    """

    adjustment: Adjustment
    residual_mm: Float[np.ndarray, "views marks 2"]
    slopes_mm: Float[np.ndarray, "parameters views marks 2"]
    moves_mm: Float[np.ndarray, "moves views marks 2"]
    pull: Float[np.ndarray, " parameters"]
    hold: Float[np.ndarray, "parameters parameters"]


class _Said(NamedTuple):
    """Normal equations of the amounts, the map's parameters eliminated."""

    matrix: Float[np.ndarray, "moves moves"]
    towards: Float[np.ndarray, " moves"]


def _state_of(state: LensState, by_name: dict[str, Take]) -> _State:
    adjustment = state.geometry.adjustment
    takes = [by_name.get(take.name, take) for take in state.geometry.takes]
    shared = [take.shared_moves_mm for take in takes]
    count = max((len(moves) for moves in shared if moves is not None), default=0)
    seen = adjustment.stack.observed_mm
    onward, moves = np.zeros_like(seen), np.zeros((count, *seen.shape))
    for k, take in enumerate(takes):
        if take.shared_moves_mm is None:
            continue
        marks = len(take.observations)
        onward[k, :marks] = observed_of(take) - seen[k, :marks]
        moves[:, k, :marks] = take.shared_moves_mm[:, _GREEN]
    free = np.flatnonzero(adjustment.prior.free)
    # A step that marks feel, and that is linear for them.
    deviation = np.sqrt(np.diag(state.uncertainty.covariance)[free])
    slopes = _slopes_mm(adjustment, free, deviation)
    value = adjustment.parameters[free] / deviation
    off = value - adjustment.prior.mean[free] / deviation
    precision = (deviation / adjustment.prior.standard_deviation[free]) ** 2
    # It stood for what the wavefront says now.
    block = adjustment.layout.blocks["aperture_shift"]
    stood = (free >= block.start) & (free < block.stop)
    residual = adjustment.residual_mm() - onward
    residual = residual - np.tensordot(value[stood], slopes[stood], 1)
    present = adjustment.stack.present[..., None]
    return _State(
        adjustment,
        np.where(present, residual, 0.0),
        slopes[~stood],
        moves,
        (precision * off)[~stood],
        np.diag(precision[~stood]),
    )


def _slopes_mm(
    adjustment: Adjustment,
    free: Int[np.ndarray, " free"],
    deviation: Float[np.ndarray, " free"],
) -> Float[np.ndarray, "free views marks 2"]:
    """Central differences: the program that predicts marks serves here too."""
    board, present = adjustment.stack.board, adjustment.stack.present[..., None]

    def predicted(index: int, step: float) -> np.ndarray:
        parameters = adjustment.parameters.copy()
        parameters[index] += step
        return replace(adjustment, parameters=parameters).predicted_mm(board)

    found = []
    for index, size in zip(free, deviation, strict=True):
        step = _STEP * float(size)
        ahead, behind = predicted(index, step), predicted(index, -step)
        found.append(np.where(present, (ahead - behind) / (2 * _STEP), 0.0))
    return np.array(found).reshape(len(deviation), *board.shape)


def _equations_of(one: _State, amounts: Float[np.ndarray, " moves"]) -> _Said:
    """At weights for what these amounts leave."""
    residual = one.residual_mm - np.tensordot(amounts, one.moves_mm, 1)
    weighed = one.adjustment
    for _ in range(2):
        rooted = _rooted(weighed)
        slopes = _flat(rooted, one.slopes_mm)
        matrix = slopes @ slopes.T + one.hold
        step = np.linalg.solve(
            matrix, slopes @ _flat(rooted, residual[None])[0] + one.pull
        )
        left = residual - np.tensordot(step, one.slopes_mm, 1)
        found = weigh_residual(weighed, left)
        least = np.minimum(found.model_variance_mm2, one.adjustment.model_variance_mm2)
        weighed = replace(one.adjustment, model_variance_mm2=least)
    rooted = _rooted(weighed)
    slopes, moves = _flat(rooted, one.slopes_mm), _flat(rooted, one.moves_mm)
    residual = _flat(rooted, one.residual_mm[None])[0]
    mixed = slopes @ moves.T
    eliminated = np.linalg.solve(slopes @ slopes.T + one.hold, mixed)
    gradient = slopes @ residual + one.pull
    return _Said(
        moves @ moves.T - mixed.T @ eliminated,
        moves @ residual - eliminated.T @ gradient,
    )


def _rooted(adjustment: Adjustment) -> Float[np.ndarray, "views marks 2 2"]:
    """Root of the weight of every mark."""
    whitening = whitening_of(adjustment.stack, adjustment.model_variance_mm2)
    used = np.where(adjustment.stack.present, adjustment.weight, 0.0)
    return whitening * np.sqrt(used)[..., None, None]


def _flat(
    rooted: Float[np.ndarray, "views marks 2 2"],
    vectors: Float[np.ndarray, "some views marks 2"],
) -> Float[np.ndarray, "some values"]:
    whitened = np.einsum("vmij,svmj->svmi", rooted, vectors)
    return whitened.reshape(len(vectors), -1)

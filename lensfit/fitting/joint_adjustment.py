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
from jaxtyping import Bool, Float, Int

from lensfit.fitting.adjust import Adjustment, model_variance_mm2
from lensfit.fitting.entrance_pupil import FittedWalk
from lensfit.fitting.half_equations import stated_statistics
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.take import Take
from lensfit.fitting.uncertainty import shared_moves_of
from lensfit.fitting.views import observed_of, whitening_of

_ROUNDS = 3
"""Of amounts, each with the variance that the ones before left the model."""
_VARIANCES = 2
"""Of the model's variance at some amounts, the map solved anew for each."""
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

    def of_first(self, count: int) -> "Amounts":
        """Those of the first errors, whatever the others were."""
        return Amounts(self.value[:count], self.covariance[:count, :count])


def amounts_of(states: Sequence[LensState], moved: Sequence[Take]) -> Amounts:
    """How large the errors were that moved the marks.

    Parameters
    ----------
    states : Fitted to centroids.
    moved : Takes of these states with marks at the chief rays, whose `shared_moves_mm`
        are one list of errors for all.
    """
    by_name = {take.name: take for take in moved}
    touched = [s for s in states if any(t.name in by_name for t in s.geometry.takes)]
    each = [one for one in (_map_of(s, by_name) for s in touched) if len(one.moves_mm)]
    count = max((len(one.moves_mm) for one in each), default=0)
    found = Amounts(np.zeros(count), np.eye(count))
    for _ in range(_ROUNDS):
        said = [_equations_of(one, found.value) for one in each]
        covariance = np.linalg.inv(sum((one.matrix for one in said), np.eye(count)))
        towards = sum((one.towards for one in said), np.zeros(count))
        found = Amounts(covariance @ towards, covariance)
    return found


def walk_with_shared_errors(state: LensState) -> FittedWalk | None:
    """The walk of a state's pupil once the errors that its marks share are solved for
    beside all of its parameters; None where no errors are known, or no walk was fitted.

    Errors of blur move the marks of a tilted chart together, by more than their noise.
    A fit that counts noise alone takes them for a walk: of a 50 mm f/1.4 one of -45 mm,
    where -15 is true, -18 usual, and no tilt of few degrees shows it.
    """
    if state.walk is None or all(
        take.shared_moves_mm is None for take in state.geometry.takes
    ):
        return None
    adjustment = state.geometry.adjustment
    walk = adjustment.layout.blocks["pupil_walk"].start
    if not adjustment.prior.free[walk]:
        return None
    one = _map_of(state, {})
    adjustment = one.adjustment
    white = _whitened(one, adjustment.model_variance_mm2)
    every = np.concatenate([white.slopes, -white.moves])
    hold = np.eye(len(every))
    hold[: len(one.hold), : len(one.hold)] = one.hold
    covariance = np.linalg.inv(every @ every.T + hold)
    pull = np.pad(one.pull, (0, len(white.moves)))
    step = -covariance @ (every @ white.residual + pull)
    row = int(np.flatnonzero(one.free == walk)[0])
    unit_mm = float(adjustment.frame.stated_focal_length_mm)
    in_mm = float(one.deviation[row]) * unit_mm
    return FittedWalk(
        float(adjustment.parameters[walk]) * unit_mm + float(step[row]) * in_mm,
        float(np.sqrt(covariance[row, row])) * in_mm,
        state.walk.measured,
    )


class _Map(NamedTuple):
    """Of one state, linear about its fit, in standard deviations of free parameters.

    Attributes
    ----------
    free, deviation : Which parameters, and their standard deviations.
    residual_mm : Predicted less observed, the observed ones moved.
    slopes_mm : d predicted / d parameter.
    moves_mm : How observed marks go with each error of the wavefront.
    pull, hold : Gradient and second derivatives of half the priors and statements.
    """

    adjustment: Adjustment
    free: Int[np.ndarray, " parameters"]
    deviation: Float[np.ndarray, " parameters"]
    residual_mm: Float[np.ndarray, "views marks 2"]
    slopes_mm: Float[np.ndarray, "parameters views marks 2"]
    moves_mm: Float[np.ndarray, "moves views marks 2"]
    pull: Float[np.ndarray, " parameters"]
    hold: Float[np.ndarray, "parameters parameters"]


class _Said(NamedTuple):
    """Normal equations of the amounts, the map's parameters eliminated."""

    matrix: Float[np.ndarray, "moves moves"]
    towards: Float[np.ndarray, " moves"]


def _map_of(state: LensState, by_name: dict[str, Take]) -> _Map:
    adjustment = state.geometry.adjustment
    takes = tuple(by_name.get(take.name, take) for take in state.geometry.takes)
    standing = _standing_in(adjustment)
    # What stood for drags goes: the wavefront says them now.
    parameters = np.where(standing, 0.0, adjustment.parameters)
    adjustment = replace(adjustment, parameters=parameters)
    free = np.flatnonzero(adjustment.prior.free & ~standing)
    # Steps that marks feel, and that are linear for them.
    deviation = np.sqrt(np.diag(state.uncertainty.covariance)[free])
    precision = (deviation / adjustment.prior.standard_deviation[free]) ** 2
    off = (parameters - adjustment.prior.mean)[free] / deviation
    stated, scale = stated_statistics(adjustment), np.outer(deviation, deviation)
    return _Map(
        adjustment,
        free,
        deviation,
        adjustment.residual_mm() - _onward_mm(adjustment, takes),
        _slopes_mm(adjustment, free, deviation),
        shared_moves_of(adjustment, takes),
        precision * off + stated.gradient[free] * deviation,
        np.diag(precision) + stated.matrix[np.ix_(free, free)] * scale,
    )


def _standing_in(adjustment: Adjustment) -> Bool[np.ndarray, " parameters"]:
    """Parameters that stand for drags while nobody knows the wavefront."""
    standing = np.zeros(len(adjustment.parameters), bool)
    standing[adjustment.layout.blocks["aperture_shift"]] = True
    return standing


def _onward_mm(
    adjustment: Adjustment, takes: Sequence[Take]
) -> Float[np.ndarray, "views marks 2"]:
    """From where the marks were observed to where moved takes have them."""
    seen_mm = adjustment.stack.observed_mm
    onward = np.zeros_like(seen_mm)
    for k, take in enumerate(takes):
        marks = len(take.observations)
        onward[k, :marks] = observed_of(take) - seen_mm[k, :marks]
    return onward


def _slopes_mm(
    adjustment: Adjustment,
    free: Int[np.ndarray, " free"],
    deviation: Float[np.ndarray, " free"],
) -> Float[np.ndarray, "free views marks 2"]:
    """Central differences: the program that predicts marks serves here too."""

    def residual(index: int, step: float) -> np.ndarray:
        parameters = adjustment.parameters.copy()
        parameters[index] += step
        return replace(adjustment, parameters=parameters).residual_mm()

    found = np.zeros((len(free), *adjustment.stack.board.shape))
    for row, index in enumerate(free):
        step = _STEP * float(deviation[row])
        found[row] = (residual(index, step) - residual(index, -step)) / (2 * _STEP)
    return found


class _Whitened(NamedTuple):
    """A map in standard deviations of its marks, all their coordinates in a row."""

    slopes: Float[np.ndarray, "parameters values"]
    moves: Float[np.ndarray, "moves values"]
    residual: Float[np.ndarray, " values"]


def _equations_of(one: _Map, amounts: Float[np.ndarray, " moves"]) -> _Said:
    """With as much variance of the model as these amounts leave, the map following."""
    left_mm = one.residual_mm - np.tensordot(amounts, one.moves_mm, 1)
    variance = one.adjustment.model_variance_mm2
    for _ in range(_VARIANCES):
        white = _whitened(one, variance)
        pull = white.slopes @ (white.residual - amounts @ white.moves) + one.pull
        followed = _following(one, white, pull)
        after_mm = left_mm - np.tensordot(followed, one.slopes_mm, 1)
        found = model_variance_mm2(one.adjustment.stack, after_mm)
        variance = np.minimum(found, one.adjustment.model_variance_mm2)
    white = _whitened(one, variance)
    mixed = white.slopes @ white.moves.T
    gradient = white.slopes @ white.residual + one.pull
    return _Said(
        white.moves @ white.moves.T - mixed.T @ _following(one, white, mixed),
        white.moves @ white.residual - mixed.T @ _following(one, white, gradient),
    )


def _following(
    one: _Map, white: _Whitened, gradient: Float[np.ndarray, "parameters *some"]
) -> Float[np.ndarray, "parameters *some"]:
    """How far the map's own parameters follow."""
    matrix = white.slopes @ white.slopes.T + one.hold
    return np.linalg.solve(matrix, gradient)


def _whitened(one: _Map, variance_mm2: Float[np.ndarray, " views"]) -> _Whitened:
    """With so much variance of the model in every photograph."""
    rooted = whitening_of(one.adjustment.stack, variance_mm2)
    rooted = rooted * np.sqrt(one.adjustment.weight)[..., None, None]

    def flat(vectors: Float[np.ndarray, "some views marks 2"]) -> np.ndarray:
        return np.einsum("vmij,svmj->svmi", rooted, vectors).reshape(len(vectors), -1)

    residual = flat(one.residual_mm[None])[0]
    return _Whitened(flat(one.slopes_mm), flat(one.moves_mm), residual)

"""Joint adjustment of the geometry and of the errors of the wavefront.

The shape of a dot's image determines coma poorly where the blur is about a pixel wide:
orders of coma can cancel except for a shift, which leaves the shape unchanged and moves
the predicted chief ray by up to half a pixel. The detections add information. The dots
of one flat chart lie on one smooth map, at every f-number and on both sides of focus.
A wavefront error that moves them differently from dot to dot therefore increases the
residuals of that map.

The wavefront fit supplies a list of independent errors, each scaled to one standard
deviation. Their amplitudes, with a standard normal prior, are estimated together with
all parameters of the map by least squares. Poses and distortion are free, so that the
amplitudes explain only what the map cannot. An error that the map can reproduce keeps
its standard deviation.

The problem is linearised about the fit to centroids, since detections move by tenths of
a pixel.

Reference: C. R. Henderson, Biometrics 31 (1975) 423, on fixed and random effects
together; on eliminating the former, B. Triggs et al., Bundle adjustment (2000),
section 6.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensfit.fitting.adjust import Adjustment, model_variance_mm2
from lensfit.fitting.chart_view import View
from lensfit.fitting.entrance_pupil import FittedPupilShift
from lensfit.fitting.held_out import stated_statistics
from lensfit.fitting.lens_state import LensState
from lensfit.fitting.uncertainty import shared_moves_of
from lensfit.fitting.view_stack import observed_of, whitening_of

_ROUNDS = 3
"""Solves for the amplitudes, each with the model variance of the one before."""
_VARIANCES = 2
"""Estimates of the model variance for given amplitudes, each after a map solve."""
_STEP = 0.1
"""Step of finite differences, in standard deviations of the parameter."""


class ErrorAmplitudes(NamedTuple):
    """Amplitudes of the wavefront's errors, in the order of `View.shared_moves_mm`.

    Attributes
    ----------
    value : In standard deviations of each error.
    covariance : Posterior covariance; the identity if the detections add nothing.
    """

    value: Float[np.ndarray, " moves"]
    covariance: Float[np.ndarray, "moves moves"]

    def leading(self, count: int) -> "ErrorAmplitudes":
        """Amplitudes of the first `count` errors, marginalised over the others."""
        return ErrorAmplitudes(self.value[:count], self.covariance[:count, :count])


def error_amplitudes(
    states: Sequence[LensState], moved: Sequence[View]
) -> ErrorAmplitudes:
    """Estimate the amplitudes of the wavefront's errors from the detections.

    Parameters
    ----------
    states : Fitted to centroids.
    moved : Views of these states with detections moved to chief rays; all their
        `shared_moves_mm` refer to the same list of errors.
    """
    by_name = {view.name: view for view in moved}
    affected = [s for s in states if any(t.name in by_name for t in s.geometry.takes)]
    maps = [_linearised_map(state, by_name) for state in affected]
    maps = [one for one in maps if len(one.moves_mm)]
    count = max((len(one.moves_mm) for one in maps), default=0)
    found = ErrorAmplitudes(np.zeros(count), np.eye(count))
    for _ in range(_ROUNDS):
        parts = [_amplitude_equations(one, found.value) for one in maps]
        covariance = np.linalg.inv(sum((one.matrix for one in parts), np.eye(count)))
        vector = sum((one.vector for one in parts), np.zeros(count))
        found = ErrorAmplitudes(covariance @ vector, covariance)
    return found


def pupil_shift_with_shared_errors(state: LensState) -> FittedPupilShift | None:
    """Shift of the entrance pupil with field angle, estimated together with the errors
    that the detections share; None if no such errors are known or no shift was fitted.

    Errors of the wavefront move the detections of a tilted chart in a common pattern,
    by more than their noise. A fit that allows for noise alone attributes this pattern
    to the pupil: for a 50 mm f/1.4 lens it gave -45 mm, where -15 is true and -18 is
    usual, and the tilts of a few degrees did not contradict it.
    """
    if state.pupil_shift is None or all(
        view.shared_moves_mm is None for view in state.geometry.takes
    ):
        return None
    adjustment = state.geometry.adjustment
    column = adjustment.layout.blocks["pupil_shift"].start
    if not adjustment.prior.free[column]:
        return None
    one = _linearised_map(state, {})
    adjustment = one.adjustment
    white = _whitened_map(one, adjustment.model_variance_mm2)
    slopes = np.concatenate([white.slopes, -white.moves])
    prior_matrix = np.eye(len(slopes))
    count = len(one.prior_matrix)
    prior_matrix[:count, :count] = one.prior_matrix
    covariance = np.linalg.inv(slopes @ slopes.T + prior_matrix)
    prior_gradient = np.pad(one.prior_gradient, (0, len(white.moves)))
    step = -covariance @ (slopes @ white.residual + prior_gradient)
    row = int(np.flatnonzero(one.free == column)[0])
    unit_mm = float(adjustment.frame.stated_focal_length_mm)
    deviation_mm = float(one.deviation[row]) * unit_mm
    return FittedPupilShift(
        float(adjustment.parameters[column]) * unit_mm
        + float(step[row]) * deviation_mm,
        float(np.sqrt(covariance[row, row])) * deviation_mm,
        state.pupil_shift.measured,
    )


class _LinearisedMap(NamedTuple):
    """The map of one state, linearised about its fit, with parameters in units of their
    standard deviations.

    Attributes
    ----------
    free, deviation : Indices of the free parameters, and their standard deviations.
    residual_mm : Predicted minus observed, with the detections moved to chief rays.
    slopes_mm : d predicted / d parameter.
    moves_mm : d observed / d amplitude, for each error of the wavefront.
    prior_gradient, prior_matrix : Gradient and Hessian of half the squared residuals of
        priors and stated values.
    """

    adjustment: Adjustment
    free: Int[np.ndarray, " parameters"]
    deviation: Float[np.ndarray, " parameters"]
    residual_mm: Float[np.ndarray, "views detections 2"]
    slopes_mm: Float[np.ndarray, "parameters views detections 2"]
    moves_mm: Float[np.ndarray, "moves views detections 2"]
    prior_gradient: Float[np.ndarray, " parameters"]
    prior_matrix: Float[np.ndarray, "parameters parameters"]


class _AmplitudeEquations(NamedTuple):
    """Normal equations of the amplitudes, with the map's parameters eliminated."""

    matrix: Float[np.ndarray, "moves moves"]
    vector: Float[np.ndarray, " moves"]


def _linearised_map(state: LensState, by_name: dict[str, View]) -> _LinearisedMap:
    adjustment = state.geometry.adjustment
    views = tuple(by_name.get(view.name, view) for view in state.geometry.takes)
    substitute = _is_centroid_bias_term(adjustment)
    # The wavefront now predicts the centroid bias that these terms approximated.
    parameters = np.where(substitute, 0.0, adjustment.parameters)
    adjustment = replace(adjustment, parameters=parameters)
    free = np.flatnonzero(adjustment.prior.free & ~substitute)
    # The unit of steps: large enough to change predictions, small enough to be linear.
    deviation = np.sqrt(np.diag(state.uncertainty.covariance)[free])
    precision = (deviation / adjustment.prior.standard_deviation[free]) ** 2
    off = (parameters - adjustment.prior.mean)[free] / deviation
    stated, scale = stated_statistics(adjustment), np.outer(deviation, deviation)
    return _LinearisedMap(
        adjustment,
        free,
        deviation,
        adjustment.residual_mm() - _displacements_mm(adjustment, views),
        _slopes_mm(adjustment, free, deviation),
        shared_moves_of(adjustment, views),
        precision * off + stated.gradient[free] * deviation,
        np.diag(precision) + stated.matrix[np.ix_(free, free)] * scale,
    )


def _is_centroid_bias_term(adjustment: Adjustment) -> Bool[np.ndarray, " parameters"]:
    """Which parameters approximate the centroid bias while no wavefront is known."""
    found = np.zeros(len(adjustment.parameters), bool)
    found[adjustment.layout.blocks["aperture_shift"]] = True
    return found


def _displacements_mm(
    adjustment: Adjustment, views: Sequence[View]
) -> Float[np.ndarray, "views detections 2"]:
    """Displacement of the detections from the fitted ones to those of `views`."""
    before_mm = adjustment.stack.observed_mm
    moves_mm = np.zeros_like(before_mm)
    for k, view in enumerate(views):
        detections = len(view.observations)
        moves_mm[k, :detections] = observed_of(view) - before_mm[k, :detections]
    return moves_mm


def _slopes_mm(
    adjustment: Adjustment,
    free: Int[np.ndarray, " free"],
    deviation: Float[np.ndarray, " free"],
) -> Float[np.ndarray, "free views detections 2"]:
    """Derivatives by central differences, with the compiled program of predictions."""

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
    """A map with its values in standard deviations of the detections, flattened."""

    slopes: Float[np.ndarray, "parameters values"]
    moves: Float[np.ndarray, "moves values"]
    residual: Float[np.ndarray, " values"]


def _amplitude_equations(
    one: _LinearisedMap, amplitudes: Float[np.ndarray, " moves"]
) -> _AmplitudeEquations:
    """Equations with the model variance of these amplitudes, after a map solve."""
    residual_mm = one.residual_mm - np.tensordot(amplitudes, one.moves_mm, 1)
    variance = one.adjustment.model_variance_mm2
    for _ in range(_VARIANCES):
        white = _whitened_map(one, variance)
        gradient = white.slopes @ (white.residual - amplitudes @ white.moves)
        change = _map_response(one, white, gradient + one.prior_gradient)
        after_mm = residual_mm - np.tensordot(change, one.slopes_mm, 1)
        found = model_variance_mm2(one.adjustment.stack, after_mm)
        variance = np.minimum(found, one.adjustment.model_variance_mm2)
    white = _whitened_map(one, variance)
    mixed = white.slopes @ white.moves.T
    gradient = white.slopes @ white.residual + one.prior_gradient
    return _AmplitudeEquations(
        white.moves @ white.moves.T - mixed.T @ _map_response(one, white, mixed),
        white.moves @ white.residual - mixed.T @ _map_response(one, white, gradient),
    )


def _map_response(
    one: _LinearisedMap,
    white: _Whitened,
    gradient: Float[np.ndarray, "parameters *some"],
) -> Float[np.ndarray, "parameters *some"]:
    """Change of the map's parameters in response to a gradient, with opposite sign."""
    matrix = white.slopes @ white.slopes.T + one.prior_matrix
    return np.linalg.solve(matrix, gradient)


def _whitened_map(
    one: _LinearisedMap, variance_mm2: Float[np.ndarray, " views"]
) -> _Whitened:
    """The map whitened with detection noise and this model variance per photograph."""
    whitening = whitening_of(one.adjustment.stack, variance_mm2)
    whitening = whitening * np.sqrt(one.adjustment.weight)[..., None, None]

    def flat(vectors: Float[np.ndarray, "some views detections 2"]) -> np.ndarray:
        return np.einsum("vmij,svmj->svmi", whitening, vectors).reshape(
            len(vectors), -1
        )

    residual = flat(one.residual_mm[None])[0]
    return _Whitened(flat(one.slopes_mm), flat(one.moves_mm), residual)

"""Robust fit of a model with given terms: iteratively reweighted least squares (IRLS).

The model variance of every photograph, that is, the residual variance in excess of the
detection noise, is estimated from the median residual and added to the noise. Weights
thus stay meaningful while the model is still coarse. Outliers are down-weighted by a
Cauchy loss, and detections beyond `REJECT_BEYOND` standard deviations are not used.

Each solve minimises the whitened residuals of all detections, statements and priors by
the method of `levenberg`, with the normal equations of `normal`.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from lensfit.fitting import levenberg
from lensfit.fitting.geometry import BoardPose, Frame, centroid_shift_mm
from lensfit.fitting.levenberg import Quadratic, minimise
from lensfit.fitting.normal import Equations, equations, predictions_mm
from lensfit.fitting.parameters import Layout, Prior
from lensfit.fitting.statements import Statements, statements_of
from lensfit.fitting.view_stack import Detections, Stack, noise_mm2, whitening_of
from lensfit.programs import kept_program

CAUCHY_SCALE = 3.0
REJECT_BEYOND = 7.0
TOLERANCE = 1e-3
LITTLE_DAMPING = 1e-7
COLLINEAR_DAMPING = 1e-5
"""For nearly collinear terms, whose minimum is long and narrow."""
_MOST_STEPS = 12
_MEDIAN_OF_CHI2 = {1: 0.6745, 2: 1.1774}
"""Median length of a whitened residual of one and of two dimensions."""
_predictions_mm = kept_program(static_argnames=("layout",))(predictions_mm)


class Stated(NamedTuple):
    """Statements (`lensfit.fitting.statements`) as p.matrix.p - 2 vector.p +
    constant."""

    matrix: Float[Array, "parameters parameters"]
    vector: Float[Array, " parameters"]
    constant: Float[Array, ""]


class Problem(NamedTuple):
    """Everything the residual needs besides the parameters."""

    views: BoardPose
    detections: Detections
    frame: Frame
    prior_mean: Float[Array, " parameters"]
    prior_precision: Float[Array, " parameters"]
    free: Float[Array, " parameters"]
    stated: Stated

    @property
    def prior(self) -> levenberg.Prior:
        """As `levenberg` wants it."""
        return levenberg.Prior(self.prior_mean, self.prior_precision, self.free)


class Solution(NamedTuple):
    """Where the solve ended.

    Attributes
    ----------
    parameters : The solution; fixed ones at their prior mean.
    converged : False when the step limit came first.
    steps : Passes over the detections.
    equations : Of both halves of the detections at the last pass, without priors, and
        of all parameters, also of those that were fixed.
    """

    parameters: Float[Array, " parameters"]
    converged: Bool[Array, ""]
    steps: Int[Array, ""]
    equations: Equations


@kept_program(static_argnames=("layout",))
def solve(
    start: Float[Array, " parameters"],
    problem: Problem,
    layout: Layout,
    tolerance: float,
    most_steps: int,
    first_damping: float,
) -> Solution:
    """Minimise the whitened residuals from `start`; compiled once per layout.

    See `levenberg.minimise` for the last three. None has a default: leaving one out
    would be another program to JAX.
    """
    found = minimise(
        lambda parameters: both_halves(parameters, problem, layout),
        start,
        problem.prior,
        tolerance,
        most_steps,
        first_damping,
    )
    return Solution(found.parameters, found.converged, found.steps, found.extra)


def both_halves(
    parameters: Float[Array, " parameters"], problem: Problem, layout: Layout
) -> tuple[Quadratic, Equations]:
    """The sum of squares of all detections and statements, and the equations of each
    half of the detections."""
    detections, frame = problem.detections, problem.frame
    found = equations(parameters, problem.views, detections, layout, frame)
    return with_statements(total(found), parameters, problem.stated), found


def total(found: Equations) -> Quadratic:
    """Both halves together."""
    return Quadratic(*(jnp.sum(part, 0) for part in found))


def with_statements(
    found: Quadratic, parameters: Float[Array, " parameters"], stated: Stated
) -> Quadratic:
    """The sum of squares, and that of what is stated."""
    turned = stated.matrix @ parameters
    squares = parameters @ (turned - 2 * stated.vector) + stated.constant
    return Quadratic(
        found.matrix + stated.matrix,
        found.gradient + turned - stated.vector,
        found.chi_squared + squares,
    )


@dataclass(frozen=True, eq=False)
class Adjustment:
    """A fitted model, with the weights of the detections.

    Attributes
    ----------
    parameters : All parameters, shared ones first.
    layout, frame, prior : Their order, their scales, and which of them are free.
    statements : Stated values of the lens and the boards; None if there are none.
    stack : The photographs.
    radius_mm : Radius of the dots of every photograph; 0 for corners and lines.
    shift_mm : Predicted centroid minus image of the centre, for every detection.
    model_variance_mm2 : Residual variance in excess of noise, per photograph.
    weight : IRLS weight of every detection, 0 to 1.
    converged : Whether the last solve met its tolerance.
    steps : Passes over the detections in all solves.
    """

    parameters: Float[np.ndarray, " parameters"]
    layout: Layout
    frame: Frame
    prior: Prior
    stack: Stack
    radius_mm: Float[np.ndarray, " views"]
    shift_mm: Float[np.ndarray, "views detections 2"]
    model_variance_mm2: Float[np.ndarray, " views"]
    weight: Float[np.ndarray, "views detections"]
    statements: Statements | None = None
    converged: bool = False
    steps: int = 0

    @property
    def used(self) -> Bool[np.ndarray, "views detections"]:
        """Detections with a positive weight."""
        return self.stack.present & (self.weight > 0)

    def filled_up(
        self, values: Float[ArrayLike, " parameters"]
    ) -> Float[np.ndarray, " room"]:
        """Values of all parameters, padded with zeros for `stack.filled_view`."""
        room = self.layout.size(len(self.stack.filled_view.aperture))
        known = np.asarray(values)
        return np.concatenate([known, np.zeros(room - len(known))])

    def detections(
        self,
        weight: Float[np.ndarray, "views detections"] | None = None,
        chunks: int | None = None,
    ) -> Detections:
        """The detections in chunks, by default all, with the current weights."""
        weight = self.weight if weight is None else weight
        whitening = whitening_of(self.stack, self.model_variance_mm2)
        whitening = whitening * np.sqrt(weight)[..., None, None]
        chunking = self.stack.chunking
        return Detections(
            view=jnp.asarray(chunking.view),
            chunks=jnp.asarray(chunking.count if chunks is None else chunks),
            board=jnp.asarray(chunking.in_chunks(self.stack.board)),
            observed_mm=jnp.asarray(
                chunking.in_chunks(self.stack.observed_mm - self.shift_mm)
            ),
            whitening=jnp.asarray(
                chunking.in_chunks(whitening) * chunking.real[..., None, None]
            ),
        )

    def predicted_mm(
        self, board: Float[np.ndarray, "views detections 2"]
    ) -> Float[np.ndarray, "views detections 2"]:
        """Predicted positions of points on the boards; zero for padding."""
        chunking = self.stack.chunking
        predicted = _predictions_mm(
            self.filled_up(self.parameters),
            self.stack.filled_view,
            chunking.view,
            chunking.in_chunks(board),
            self.layout,
            self.frame,
        )
        return chunking.from_chunks(np.asarray(predicted), board)

    def residual_mm(self) -> Float[np.ndarray, "views detections 2"]:
        """Predicted minus observed; of a line sample, across the line."""
        stack = self.stack
        seen = stack.observed_mm - self.shift_mm
        residual = self.predicted_mm(stack.board) - seen
        n = stack.normal
        across = np.sum(np.nan_to_num(n) * residual, -1, keepdims=True) * n
        residual = np.where(np.isfinite(n), across, residual)
        return np.where(stack.present[..., None], residual, 0.0)


def problem_of(
    adjustment: Adjustment,
    weight: Float[np.ndarray, "views detections"] | None = None,
    chunks: int | None = None,
) -> Problem:
    """The least-squares problem of all detections, or of some chunks."""
    prior = adjustment.prior
    deviation = np.where(prior.free, prior.standard_deviation, 1.0)
    return Problem(
        views=adjustment.stack.view,
        detections=adjustment.detections(weight, chunks),
        frame=adjustment.frame,
        prior_mean=jnp.asarray(prior.mean),
        prior_precision=jnp.asarray(np.where(prior.free, deviation**-2.0, 0.0)),
        free=jnp.asarray(prior.free.astype(float)),
        stated=stated_equations(adjustment),
    )


def stated_equations(adjustment: Adjustment) -> Stated:
    """Equations of the stated values; zeros if there are none."""
    statements, size = adjustment.statements, len(adjustment.parameters)
    if statements is None:
        return Stated(*map(jnp.zeros, ((size, size), size, ())))
    found = statements.matrix, statements.vector, statements.constant
    return Stated(*map(jnp.asarray, found))


def adjust(
    adjustment: Adjustment,
    rounds: int = 2,
    chunks: int | None = None,
    damping: float = LITTLE_DAMPING,
) -> Adjustment:
    """Solve and reweight, `rounds` times; `chunks` restricts the fit to some chunks."""
    for _ in range(rounds):
        problem = problem_of(adjustment, chunks=chunks)
        adjustment = with_robust_weights(
            adjustment_at_solution(adjustment, problem, damping=damping)
        )
    return with_centroid_shift(adjustment)


def adjustment_at_solution(
    adjustment: Adjustment,
    problem: Problem,
    most_steps: int = _MOST_STEPS,
    damping: float = LITTLE_DAMPING,
) -> Adjustment:
    """The adjustment at the solution of a problem."""
    found = _solve(adjustment, problem, most_steps, damping)
    return replace(
        adjustment,
        parameters=np.asarray(found.parameters)[: len(adjustment.parameters)],
        converged=bool(found.converged),
        steps=adjustment.steps + int(found.steps),
    )


def equations_at(adjustment: Adjustment) -> Equations:
    """The equations of both halves of the detections at the present parameters."""
    found = _solve(adjustment, problem_of(adjustment), 1, LITTLE_DAMPING).equations
    n = len(adjustment.parameters)
    return Equations(
        jnp.asarray(np.asarray(found.matrix)[:, :n, :n]),
        jnp.asarray(np.asarray(found.gradient)[:, :n]),
        found.chi_squared,
    )


def _solve(
    adjustment: Adjustment, problem: Problem, most_steps: int, damping: float
) -> Solution:
    """The solution, with parameters padded as by `Adjustment.filled_up`."""
    filled_up = adjustment.filled_up
    roomy = problem._replace(
        views=adjustment.stack.filled_view,
        prior_mean=jnp.asarray(filled_up(problem.prior_mean)),
        prior_precision=jnp.asarray(filled_up(problem.prior_precision)),
        free=jnp.asarray(filled_up(problem.free)),
        stated=_filled_up(problem.stated, adjustment),
    )
    start = jnp.asarray(filled_up(adjustment.parameters))
    layout = adjustment.layout
    return solve(start, roomy, layout, TOLERANCE, most_steps, damping)


def _filled_up(stated: Stated, adjustment: Adjustment) -> Stated:
    """The same, padded with zeros for `stack.filled_view`."""
    vector = adjustment.filled_up(stated.vector)
    matrix = jnp.pad(stated.matrix, (0, len(vector) - stated.vector.size))
    return Stated(matrix, jnp.asarray(vector), stated.constant)


def with_centroid_shift(adjustment: Adjustment) -> Adjustment:
    """The same, with `shift_mm` computed at the present parameters."""
    chunking, views = adjustment.stack.chunking, adjustment.stack.filled_view
    shift = centroid_shift_mm(
        adjustment.filled_up(adjustment.parameters),
        views,
        chunking.view,
        chunking.in_chunks(adjustment.stack.board),
        np.resize(adjustment.radius_mm, len(views.aperture)),
        adjustment.layout,
        adjustment.frame,
    )
    joined = chunking.from_chunks(np.asarray(shift), adjustment.shift_mm)
    return replace(adjustment, shift_mm=joined)


def with_robust_weights(adjustment: Adjustment) -> Adjustment:
    """The same, with model variances and robust weights of the present residuals, those
    of stated values included."""
    residual = adjustment.residual_mm()
    variance = model_variance_mm2(adjustment.stack, residual)
    whitening = whitening_of(adjustment.stack, variance)
    whitened = np.einsum("vmij,vmj->vmi", whitening, residual)
    distance = np.linalg.norm(whitened, axis=-1)
    weight = 1 / (1 + (distance / CAUCHY_SCALE) ** 2)
    weight = np.where(distance > REJECT_BEYOND, 0.0, weight)
    weight = np.where(adjustment.stack.present, weight, 0.0)
    stated = adjustment.statements
    if stated is not None:
        stated = stated.with_robust_weights(adjustment.parameters)
    return replace(
        adjustment, model_variance_mm2=variance, weight=weight, statements=stated
    )


def model_variance_mm2(
    stack: Stack, residual_mm: Float[np.ndarray, "views detections 2"]
) -> Float[np.ndarray, " views"]:
    """Per photograph: robust residual variance in excess of the detection noise."""
    length = np.linalg.norm(residual_mm, axis=-1)
    noise = noise_mm2(stack)
    variance = np.zeros(len(length))
    for k in range(len(length)):
        here = stack.present[k]
        dimensions = 1 if np.isfinite(stack.normal[k][here]).any() else 2
        scale = np.median(length[k][here]) / _MEDIAN_OF_CHI2[dimensions]
        floor = (2e-3 * stack.mm_per_px[k]) ** 2
        variance[k] = max(scale**2 - np.median(noise[k][here]), floor)
    return variance


def fitted_depths_mm(adjustment: Adjustment) -> Float[np.ndarray, " views"]:
    """From the entrance pupil to the middle of every board, along the axis."""
    layout = adjustment.layout
    local = adjustment.parameters[layout.shared :].reshape(-1, layout.local)
    nearer = local[:, layout.local_blocks["pose"]][:, 5]
    start_mm = np.asarray(adjustment.stack.view.translation_mm)[: len(local), 2]
    return start_mm * (1 + nearer)


def with_fitted_scale_as_origin(fitted: Adjustment) -> Adjustment:
    """The same fit, with its principal distance and poses as the origin of parameters.

    Further steps then stay small, so that linearised statements remain accurate, and
    the distance at which the map holds is the fitted distance of the boards.
    """
    layout, frame, stack = fitted.layout, fitted.frame, fitted.stack
    if fitted.statements is None:
        return fitted
    views = len(stack.board)
    focal = layout.blocks["focal_length"]
    poses = layout.local_indices("pose", views)
    parameters, mean = fitted.parameters.copy(), fitted.prior.mean.copy()
    ratio = float(np.exp(parameters[focal][0]))
    before_mm = np.asarray(stack.view.translation_mm)
    moved = parameters[poses][:, 3:] * before_mm[:, 2:]
    translation_mm = before_mm + moved
    depths = fitted_depths_mm(fitted) / before_mm[:, 2]
    unit_mm = float(frame.stated_focal_length_mm) * ratio
    parameters[focal] = 0.0
    for name in ("pupil_offset", "pupil_gap", "pupil_shift"):
        for values in (parameters, mean):
            values[layout.blocks[name]] /= ratio
    parameters[poses[:, 3:]] = 0.0
    mean[focal] = 0.0
    view = stack.view._replace(translation_mm=jnp.asarray(translation_mm))
    statements = statements_of(
        fitted.statements.facts, layout, unit_mm, translation_mm[:, 2]
    )
    return replace(
        fitted,
        parameters=parameters,
        prior=replace(fitted.prior, mean=mean),
        frame=frame._replace(
            stated_focal_length_mm=jnp.asarray(unit_mm),
            board_distance_mm=frame.board_distance_mm * float(np.median(depths)),
        ),
        stack=replace(stack, view=view),
        statements=replace(statements, weight=fitted.statements.weight),
    )

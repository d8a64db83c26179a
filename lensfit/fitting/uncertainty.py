"""Covariance of the fitted parameters, and standard deviations of predicted positions.

The covariance has four parts:

- the inverse of the normal equations at the solution, that is, of the detections,
  scaled by the reduced chi-squared, of the stated values, and of the priors;
- the common errors of stated values that all states of a lens share;
- the errors of the wavefront, where detections were moved from centroids to chief rays:
  each of its independent errors moves all detections, and the resulting change of the
  solution is added;
- systematic errors that residuals do not show (`fitting.systematic`): smooth errors of
  the detections, and distortion for which the model has no term, are absorbed by the
  terms it has. The maps of thirty traced lenses, some of them decentred, were wrong by
  `SYSTEMATIC_PX`, three times as much as noise alone predicts. The principal point and
  every radial, decentering, thin-prism and anamorphic term, kept or not, are therefore
  given joint errors of that rms effect on the detections, after the poses have been
  adjusted, however many detections there are.

Two more belong to the entrance-pupil shift alone, and change no chief ray at the chart:
the next order of the shift, and a shift that was held fixed. Extrapolation has no part
of its own: at a corner without detections the model carries these errors outwards.

Standard deviations of chief rays, without the part that a change of the camera's pose
would compensate, are computed in `lensfit.optics.map_deviations`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from lensfit.fitting.adjust import Adjustment, equations_at
from lensfit.fitting.chart_view import View
from lensfit.fitting.decentring import tolerances_of
from lensfit.fitting.geometry import NAMED, compiled_distortion_of
from lensfit.fitting.held_out import explained_by, halves_of, stated_statistics
from lensfit.fitting.parameters import Layout, loose_prior, release
from lensfit.fitting.systematic import covariance_of_equations, systematic_covariance
from lensfit.fitting.usual_lens import next_order_of_pupil_shift_mm
from lensfit.fitting.view_stack import residuals_of
from lensfit.optics import map_deviations as optics

SYSTEMATIC_PX = 0.006
"""Rms effect of systematic errors on the detections, after the poses were adjusted. For
thirty random traced lenses the median error along either axis was .005; without this
part the stated standard deviation was .0016."""
_GREEN = 1
_LEAST_MOVE = 1e-3
"""Share of the largest move; smaller ones are negligible against the noise."""
_NAMED_TERMS = ("principal_point", "radial", *NAMED)
_LANDING = (
    "focal_length",
    "principal_point",
    "radial",
    "squeeze",
    *NAMED,
    "free_field",
)
"""What `optics.map_deviations.changed_distortion` changes, in its order and units."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of all parameters.

    Rows of fixed parameters are zero, except for a fixed shift of the entrance pupil,
    and for named terms of the lens that model selection left out: these have the
    variance of systematic errors.

    Attributes
    ----------
    parts : What the covariance is the sum of, by the errors it comes from: of
        "detections" (their noise, beside priors and stated values), the "wavefront"
        (common to detections that it moved), "statements" (common to all stated
        values), and "systematic" ones that no residual shows.
    """

    parts: dict[str, Float[np.ndarray, "parameters parameters"]]
    layout: Layout

    @cached_property
    def covariance(self) -> Float[np.ndarray, "parameters parameters"]:
        """Of all errors together."""
        return np.sum(list(self.parts.values()), 0)

    def deviation(self, block: str) -> Float[np.ndarray, " terms"]:
        """Standard deviations of the parameters of a named block."""
        where = self.layout.blocks[block]
        return np.sqrt(np.maximum(np.diag(self.covariance)[where], 0.0))


def uncertainty_of(adjustment: Adjustment, views: tuple[View, ...]) -> Uncertainty:
    """Covariance at the solution of an adjustment.

    Parameters
    ----------
    views : Those that were adjusted, in the same order.
    """
    adjustment = _with_possible_decentring(adjustment)
    one, other = halves_of(adjustment)
    free = adjustment.prior.free
    precision = adjustment.prior.standard_deviation[free] ** -2.0
    residuals = residuals_of(adjustment.stack)[adjustment.used]
    count = max(int(residuals.sum()) - int(free.sum()), 1)
    scale = (one.sum_of_squares + other.sum_of_squares) / count
    matrix = (one.matrix + other.matrix) / max(scale, 1.0)
    matrix = (matrix + stated_statistics(adjustment).matrix)[np.ix_(free, free)]
    inside = covariance_of_equations(matrix + np.diag(precision))
    moves = shared_moves_of(adjustment, views)
    shared = _solution_moves(moves, adjustment, inside / max(scale, 1.0))
    stated = _solution_moves_by_stated_values(adjustment, inside)
    of_free = {
        "detections": inside,
        "wavefront": shared.T @ shared,
        "statements": stated.T @ stated,
        "systematic": np.zeros_like(inside),
    }
    rows = np.flatnonzero(free)
    parts = {
        name: _embedded_covariance(part, rows, len(free))
        for name, part in of_free.items()
    }
    _add_variance_of_next_pupil_shift_order(parts["systematic"], adjustment)
    _add_variance_of_fixed_pupil_shift(parts["systematic"], adjustment)
    terms = _rows_of(adjustment.layout, _NAMED_TERMS)
    parts["systematic"][np.ix_(terms, terms)] += _systematic(adjustment, terms)
    return Uncertainty(parts, adjustment.layout)


def _embedded_covariance(
    part: Float[np.ndarray, "some some"], rows: Int[np.ndarray, " some"], size: int
) -> Float[np.ndarray, "parameters parameters"]:
    """A covariance of some parameters among those of all, the others' zero."""
    found = np.zeros((size, size))
    found[np.ix_(rows, rows)] = part
    return found


def _with_possible_decentring(adjustment: Adjustment) -> Adjustment:
    """The same with decentring terms that were left out free within tolerances.

    They were left out for having no visible effect beside that of the principal point,
    which has the same but for a turn of the camera: with the terms at zero it would
    seem to be known as well as the residuals.
    """
    prior, blocks = adjustment.prior, adjustment.layout.blocks
    tolerances = tolerances_of(adjustment.layout)
    free = {name for name in tolerances if prior.free[blocks[name]].any()}
    if free != {"principal_point"}:
        return adjustment
    for name in tolerances.keys() - free:
        prior = release(prior, blocks[name], tolerances[name])
    return replace(adjustment, prior=prior)


def _add_variance_of_next_pupil_shift_order(
    covariance: Float[np.ndarray, "parameters parameters"], adjustment: Adjustment
) -> None:
    """Add, in place, the variance of the pupil shift with field angle by its neglected
    sin^4 term; where the shift comes from another state, its variance includes this."""
    frame, layout = adjustment.frame, adjustment.layout
    stated = adjustment.statements
    if stated is not None and "pupil_shift_at_other_focus" in stated.quantities:
        return
    where = layout.blocks["pupil_shift"]
    if not adjustment.prior.free[where].any():
        return
    unit_mm = float(frame.stated_focal_length_mm)
    corner_mm = float(frame.valid_radius * frame.reference_radius_mm)
    shift_mm = float(adjustment.parameters[where][0]) * unit_mm
    left_mm = next_order_of_pupil_shift_mm(shift_mm, unit_mm, corner_mm)
    covariance[where, where] += (left_mm / unit_mm) ** 2


def _add_variance_of_fixed_pupil_shift(
    covariance: Float[np.ndarray, "parameters parameters"], adjustment: Adjustment
) -> None:
    """Set, in place, the variance of a pupil shift that the fit kept at a known value.
    It moves nothing at the chart's distance, so it has no covariance with others."""
    where, stated = adjustment.layout.blocks["pupil_shift"], adjustment.statements
    if stated is None or adjustment.prior.free[where].any():
        return
    known_mm = stated.facts.perspective.pupil_shift.standard_deviation_mm
    unit_mm = float(adjustment.frame.stated_focal_length_mm)
    covariance[where, where] = (known_mm / unit_mm) ** 2


def _solution_moves_by_stated_values(
    adjustment: Adjustment, inverse: Float[np.ndarray, "free free"]
) -> Float[np.ndarray, "statements free"]:
    """Change of the solution by one standard deviation of each common error of the
    stated values."""
    if adjustment.statements is None:
        return np.zeros((0, len(inverse)))
    return adjustment.statements.common_pulls[:, adjustment.prior.free] @ inverse


def _systematic(
    adjustment: Adjustment, terms: Int[np.ndarray, " terms"]
) -> Float[np.ndarray, "terms terms"]:
    """Covariance of named terms that jointly move the detections by `SYSTEMATIC_PX`."""
    layout, views = adjustment.layout, len(adjustment.stack.board)
    poses = layout.local_indices("pose", views).ravel()
    both = np.concatenate([terms, poses])
    nothing = np.zeros(0, int)
    loose = loose_prior(adjustment.parameters, layout, nothing, both)
    one, other = halves_of(replace(adjustment, prior=loose))
    precision = np.diag(np.where(loose.free, loose.standard_deviation, 1.0) ** -2.0)
    matrix = one.matrix + other.matrix
    of_terms, of_poses = np.ix_(terms, terms), np.ix_(poses, poses)
    mixed = matrix[np.ix_(poses, terms)]
    followed = np.linalg.solve(matrix[of_poses] + precision[of_poses], mixed)
    seen = matrix[of_terms] - mixed.T @ followed
    return systematic_covariance(
        (seen + seen.T) / 2,
        np.diag(precision)[terms],
        explained_by(SYSTEMATIC_PX, adjustment),
    )


def shared_moves_of(
    adjustment: Adjustment, views: tuple[View, ...]
) -> Float[np.ndarray, "moves views detections 2"]:
    """Common moves of the detections by each error of the wavefront, mm; no moves where
    detections are centroids."""
    known = [t.shared_moves_mm for t in views if t.shared_moves_mm is not None]
    most = max((len(moves) for moves in known), default=0)
    moved = np.zeros((most, *adjustment.stack.observed_mm.shape))
    for k, view in enumerate(views):
        if view.shared_moves_mm is not None:
            count, _, detections, _ = view.shared_moves_mm.shape
            moved[:count, k, :detections] = view.shared_moves_mm[:, _GREEN]
    return moved


def _solution_moves(
    moves: Float[np.ndarray, "moves views detections 2"],
    adjustment: Adjustment,
    inverse: Float[np.ndarray, "free free"],
) -> Float[np.ndarray, "moves free"]:
    """Change of the solution when detections move, to first order."""
    free = adjustment.prior.free

    def gradient(moved_mm: np.ndarray | float) -> np.ndarray:
        stack = adjustment.stack
        stack = replace(stack, observed_mm=stack.observed_mm + moved_mm)
        found = equations_at(replace(adjustment, stack=stack)).gradient
        return np.asarray(found).sum(0)[free]

    still = gradient(0.0)
    pulls = [gradient(moved) - still for moved in _principal_moves(moves)]
    return -np.array(pulls).reshape(len(pulls), len(inverse)) @ inverse


def _principal_moves(
    moves: Float[np.ndarray, "moves views detections 2"],
) -> Float[np.ndarray, "fewer views detections 2"]:
    """The principal components of moves, which have the same covariance: many errors
    move all detections alike, and every move costs a pass over them."""
    flat = moves.reshape(len(moves), math.prod(moves.shape[1:]))
    _, size, direction = np.linalg.svd(flat, full_matrices=False)
    worth = size > _LEAST_MOVE * np.max(size, initial=0.0)
    principal = size[worth, None] * direction[worth]
    return principal.reshape(len(principal), *moves.shape[1:])


def position_deviation_mm(
    adjustment: Adjustment,
    uncertainty: Uncertainty,
    undistorted_mm: Float[np.ndarray, "points 2"],
) -> Float[np.ndarray, " points"]:
    """Standard deviation of the distorted position (root sum of both axes' variances).

    `undistorted_mm` should cover the frame: moves that a change of pose would
    compensate are fitted over these points and removed.
    """
    each = position_deviations_mm(adjustment, uncertainty, undistorted_mm)
    return np.hypot(*each.T)


def position_deviations_mm(
    adjustment: Adjustment,
    uncertainty: Uncertainty,
    undistorted_mm: Float[np.ndarray, "points 2"],
) -> Float[np.ndarray, "points 2"]:
    """`position_deviation_mm` along x and along y."""
    return _landing_deviations_mm(adjustment, uncertainty.covariance, undistorted_mm)


def position_variances_mm2(
    adjustment: Adjustment,
    uncertainty: Uncertainty,
    undistorted_mm: Float[np.ndarray, "points 2"],
) -> dict[str, Float[np.ndarray, " points"]]:
    """What each of `Uncertainty.parts` adds to the square of `position_deviation_mm`;
    points as there."""
    parts = uncertainty.parts
    stacked = np.stack(list(parts.values()))
    each = _landing_deviations_mm(adjustment, stacked, undistorted_mm)
    return dict(zip(parts, np.sum(each**2, -1), strict=True))


def _landing_deviations_mm(
    adjustment: Adjustment,
    covariance: Float[np.ndarray, "*errors parameters parameters"],
    undistorted_mm: Float[np.ndarray, "points 2"],
) -> Float[np.ndarray, "*errors points 2"]:
    """Standard deviations of positions by the covariance of all parameters."""
    layout = adjustment.layout
    shared = jnp.asarray(adjustment.parameters[: layout.shared])
    rows = _rows_of(layout, _LANDING)
    return optics.position_deviations_mm(
        undistorted_mm,
        compiled_distortion_of(shared, layout, adjustment.frame),
        np.ascontiguousarray(covariance[..., rows[:, None], rows]),
        undistorted_mm,
    )


def _rows_of(layout: Layout, names: Sequence[str]) -> Int[np.ndarray, " numbers"]:
    blocks = [layout.blocks[name] for name in names]
    return np.concatenate([np.arange(b.start, b.stop) for b in blocks])

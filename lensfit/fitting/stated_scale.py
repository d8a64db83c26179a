"""The scale of a lens state before the first step, from the stated values.

Boards square to the axis have the same image at twice the focal length and twice the
distance. The scale therefore follows from stated values alone: the focal length,
distances measured from the sensor, and the usual position of the entrance pupil, from
which perspective counts. Start poses are scaled by a robust least-squares fit to these
values; the geometric fit then has the same values as residuals
(`lensfit.fitting.statements`).
"""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from lensfit.fitting.adjust import Adjustment, fitted_depths_mm
from lensfit.fitting.statements import CAUCHY_SCALE, Facts, statements_of

_LARGEST = 50.0
"""Largest logarithm of a ratio, so that trial steps do not overflow."""


class StatedScale(NamedTuple):
    """The scale of poses that were found with some principal distance.

    Attributes
    ----------
    ratio : Factor for principal distance and depths.
    cost : Remaining robust sum of squares, in widths.
    """

    ratio: float
    cost: float


def stated_scale(
    facts: Facts,
    principal_distance_mm: float,
    depth_mm: Float[np.ndarray, " views"],
) -> StatedScale:
    """The scale with the smallest robust residuals of the stated values.

    Parameters
    ----------
    principal_distance_mm : With which the poses were found.
    depth_mm : Distances of the boards from the entrance pupil, in those poses.
    """
    measured = np.isfinite(facts.target_distance_mm)
    stated_mm = facts.target_distance_mm[measured]
    width_mm = np.array([facts.widths.of_distance_mm(float(d)) for d in stated_mm])
    width_mm = width_mm * np.sqrt(facts.shared[measured])
    pupil = facts.perspective.pupil

    def residuals(guess: np.ndarray) -> np.ndarray:
        ratio = np.exp(min(guess[0], _LARGEST))
        offset_mm = guess[1] * pupil.standard_deviation_mm
        fitted_mm = depth_mm[measured] * ratio + offset_mm
        c_mm = principal_distance_mm * ratio
        of_focal = np.log(c_mm / facts.principal_distance_mm)
        return np.concatenate(
            [
                (fitted_mm - stated_mm) / width_mm,
                [
                    of_focal / facts.focal_length_width,
                    (offset_mm - pupil.offset_mm) / pupil.standard_deviation_mm,
                ],
            ]
        )

    stated = np.log(facts.principal_distance_mm / principal_distance_mm)
    usual = pupil.offset_mm / pupil.standard_deviation_mm
    starts = [np.array([stated, usual])]
    if measured.any():
        # If focal length and distances contradict each other, either may be right.
        ratios = (stated_mm - pupil.offset_mm) / depth_mm[measured]
        starts.append(np.array([np.log(max(np.median(ratios), 0.05)), usual]))
    found = [
        least_squares(residuals, start, loss="cauchy", f_scale=CAUCHY_SCALE)
        for start in starts
    ]
    best = min(found, key=lambda one: one.cost)
    return StatedScale(float(np.exp(best.x[0])), 2 * float(best.cost))


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

"""The scale that a tape measure gives: boards lie as far away as was stated.

Tape measures count from the sensor, perspective from the entrance pupil. Where nobody
knows that pupil it is assumed one principal distance in front of the sensor, as in a
thin lens.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import jax.numpy as jnp
import numpy as np

from lensfit.errors import FitError
from lensfit.fit.adjust import Adjustment, fitted_depths_mm
from lensfit.fit.start import Pose
from lensfit.fit.take import Take

_LEAST_BELIEVED, _MOST_BELIEVED = 0.8, 1.25
"""Ratios beyond mean a wrong pitch, distance, focal length or sensor width."""
_WORTH_A_NOTE = 0.05
_Mm = TypeVar("_Mm", float, np.ndarray)
"""Of one board, or of many."""


def distance_ratio(stated_mm: _Mm, depth_mm: _Mm, pupil_offset_mm: float) -> _Mm:
    """Distance of a board as stated over that of its pose, from the entrance pupil.

    Parameters
    ----------
    stated_mm : From the sensor.
    depth_mm : Of the pose, from the entrance pupil.
    pupil_offset_mm : Entrance pupil in front of the sensor.
    """
    return (stated_mm - pupil_offset_mm) / depth_mm


def scaled_poses(
    takes: list[Take],
    poses: list[Pose],
    focal_mm: float,
    pupil_offset_mm: float | None,
) -> tuple[float, list[Pose], list[str]]:
    """The principal distance that puts the boards where they were measured to be.

    Returns
    -------
    The principal distance, the poses it goes with, and a note where it is far from
    `focal_mm`.

    Raises
    ------
    FitError : A board is stated to be where no such lens would see it.
    """
    offset_mm = focal_mm if pupil_offset_mm is None else pupil_offset_mm
    ratios = [
        _believed(take, take.target_distance_mm, pose, offset_mm)
        for take, pose in zip(takes, poses, strict=True)
        if take.target_distance_mm is not None
    ]
    if not ratios:
        return focal_mm, poses, []
    ratio = float(np.median(ratios))
    scale = np.array([1.0, 1.0, ratio])
    farther = [Pose(p.rotation, p.translation_mm * scale) for p in poses]
    notes = []
    if abs(ratio - 1) > _WORTH_A_NOTE:
        notes.append(
            f"the measured target distance implies a principal distance "
            f"{100 * (ratio - 1):+.1f} % from the stated focal length"
        )
    return focal_mm * ratio, farther, notes


def _believed(take: Take, stated_mm: float, pose: Pose, offset_mm: float) -> float:
    depth_mm = float(pose.translation_mm[2])
    ratio = distance_ratio(stated_mm, depth_mm, offset_mm)
    if not _LEAST_BELIEVED < ratio < _MOST_BELIEVED:
        raise FitError(
            f"the marks put the target at {depth_mm + offset_mm:.4g} mm, the shoot "
            f"says {stated_mm:g} mm",
            where=take.name,
            remedy="check pitch_mm, target_distance_mm, focal_length_mm and the "
            "sensor width",
        )
    return ratio


def at_stated_distance(
    fitted: Adjustment, takes: Sequence[Take], pupil_offset_mm: float | None
) -> Adjustment:
    """Principal distance and depths scaled so that boards are where they were measured.

    A start pose takes the middle of the frame for free of distortion; of a barrel it
    sees a lens that is too long. For boards square to the axis the scale changes no
    image. Boards at the smallest aperture are believed before others, whose blur moves
    marks.
    """
    stated_mm = np.array([take.target_distance_mm for take in takes], float)
    measured = np.isfinite(stated_mm)
    if not measured.any():
        return fitted
    frame, stack = fitted.frame, fitted.stack
    smallest = measured & (np.asarray(stack.view.aperture)[: len(takes)] == 0)
    wanted = smallest if smallest.any() else measured
    # A pupil that is assumed one principal distance ahead is scaled along.
    moving_mm, fixed_mm = 0.0, pupil_offset_mm
    if fixed_mm is None:
        moving_mm, fixed_mm = float(frame.stated_focal_length_mm), 0.0
    depth_mm = fitted_depths_mm(fitted) + moving_mm
    ratio = float(np.median(distance_ratio(stated_mm, depth_mm, fixed_mm)[wanted]))
    farther_mm = np.asarray(stack.view.translation_mm) * [1.0, 1.0, ratio]
    view = stack.view._replace(translation_mm=jnp.asarray(farther_mm))
    return replace(
        fitted,
        frame=frame._replace(
            stated_focal_length_mm=frame.stated_focal_length_mm * ratio,
            board_distance_mm=frame.board_distance_mm * ratio,
        ),
        stack=replace(stack, view=view),
    )

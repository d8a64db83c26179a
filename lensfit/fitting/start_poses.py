"""Start values: poses by homographies, and their scale by what was stated.

A homography is decomposed with the stated focal length. Distortion is least near the
middle of the frame, so the homography is fitted to the third of the detections nearest
to it. Rotation and distance are as accurate as the stated focal length, which suffices
as a start.

Boards square to the axis have the same image at twice the focal length and twice the
distance. The scale therefore follows from stated values alone: the focal length,
distances measured from the sensor, and the usual position of the entrance pupil, from
which perspective counts. Start poses are scaled by a robust least-squares fit to these
values; the geometric fit then has the same values as residuals
(`lensfit.fitting.statements`).

Reference: Z. Zhang, IEEE PAMI 22 (2000) 1330-1334, section 3.1.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from lensfit.errors import FitError
from lensfit.fitting.statements import CAUCHY_SCALE, Facts

_FEWEST_DETECTIONS = 20
_CENTRAL_SHARE = 1 / 3
_LEAST_TILT = 0.12
"""Sine of the tilt below which a homography is silent about the focal length."""
_LEAST_STATED_TILT = 0.07
"""The same with the stated focal length, which may be off itself."""
_LARGEST = 50.0
"""Largest logarithm of a ratio, so that trial steps do not overflow."""


class Pose(NamedTuple):
    """Board axes to camera axes: camera = rotation @ board + translation."""

    rotation: Float[np.ndarray, "3 3"]
    translation_mm: Float[np.ndarray, "3"]


def pose_from_homography(
    board_mm: Float[np.ndarray, "detections 2"],
    image_mm: Float[np.ndarray, "detections 2"],
    principal_distance_mm: float,
    where: str,
) -> Pose:
    """Pose of a flat board, from detections whose image has no distortion to speak of.

    Raises
    ------
    FitError : The detections lie on one line, or the board would be edge-on or behind.
    """
    order = np.argsort(np.sum(image_mm**2, -1))
    central = order[: max(_FEWEST_DETECTIONS, int(len(order) * _CENTRAL_SHARE))]
    scale_mm = float(np.ptp(board_mm[central], axis=0).max())
    plane = image_mm[central] / principal_distance_mm
    matrix, _ = cv2.findHomography(board_mm[central] / max(scale_mm, 1e-9), plane, 0)
    centred = board_mm[central] - board_mm[central].mean(0)
    spread = np.linalg.svd(centred, compute_uv=False)
    if matrix is None or spread[1] < 1e-6 * spread[0]:
        raise FitError(
            "the points lie on one line, which does not fix where the target stood",
            where=where,
            remedy="photograph at least two rows and two columns of the target",
        )
    matrix = matrix @ np.diag([1 / scale_mm, 1 / scale_mm, 1.0])
    return _pose(matrix, where)


def _pose(matrix: np.ndarray, where: str) -> Pose:
    lengths = np.linalg.norm(matrix[:, :2], axis=0)
    matrix = matrix / np.sqrt(lengths[0] * lengths[1])
    if matrix[2, 2] < 0:
        matrix = -matrix
    first, second, translation = matrix.T
    u, _, vt = np.linalg.svd(np.stack([first, second, np.cross(first, second)], 1))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    if not translation[2] > 0 or rotation[2, 2] <= 0.05:
        raise FitError(
            "the points are not those of a board in front of the camera",
            where=where,
            remedy="check the overlay: are the points numbered as on the target?",
        )
    return Pose(rotation, translation)


def focal_length_from_homographies(
    boards_mm: list[Float[np.ndarray, "detections 2"]],
    images_mm: list[Float[np.ndarray, "detections 2"]],
    stated_mm: float | None = None,
) -> float | None:
    """Principal distance that several tilted views agree on; None when they do not.

    With the principal point in the middle of the frame each homography gives two
    linear equations in 1/f^2, which tilt alone makes solvable: without it they
    weigh noise against distortion. Distortion that is taken for a tilt makes the lens
    long, and a long lens the tilt large: with the stated focal length, too, there must
    be one.
    """
    left, right, foreshortening = [], [], [0.0]
    for board_mm, image_mm in zip(boards_mm, images_mm, strict=True):
        order = np.argsort(np.sum(image_mm**2, -1))
        central = order[: max(_FEWEST_DETECTIONS, int(len(order) * _CENTRAL_SHARE))]
        extent = np.ptp(board_mm, axis=0).max()
        h, _ = cv2.findHomography(board_mm[central] / extent, image_mm[central], 0)
        if h is None:
            continue
        h = h / np.linalg.norm(h[:, :2])
        a, b = h[:, 0], h[:, 1]
        left += [
            a[0] * b[0] + a[1] * b[1],
            a[0] ** 2 + a[1] ** 2 - b[0] ** 2 - b[1] ** 2,
        ]
        right += [-a[2] * b[2], -(a[2] ** 2) + b[2] ** 2]
        foreshortening.append(float(np.hypot(a[2], b[2])) * 2**0.5)
    left_, right_ = np.array(left), np.array(right)
    inverse_square = float(left_ @ right_ / max(left_ @ left_, 1e-300))
    if not inverse_square > 0:
        return None
    found = inverse_square**-0.5
    tilted = found * max(foreshortening) > _LEAST_TILT
    if stated_mm is not None:
        tilted &= stated_mm * max(foreshortening) > _LEAST_STATED_TILT
    return found if tilted else None


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

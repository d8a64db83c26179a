"""Start values of a pose: a homography, decomposed with the stated focal length.

Distortion is least near the middle of the frame, so the homography is fitted to the
third of the detections nearest to it. Rotation and distance are as accurate as the
stated focal length, which suffices as a start.

Reference: Z. Zhang, IEEE PAMI 22 (2000) 1330-1334, section 3.1.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from lensfit.errors import FitError

_FEWEST_DETECTIONS = 20
_CENTRAL_SHARE = 1 / 3
_LEAST_TILT = 0.12
"""Sine of the tilt below which a homography is silent about the focal length."""
_LEAST_STATED_TILT = 0.07
"""The same with the stated focal length, which may be off itself."""


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

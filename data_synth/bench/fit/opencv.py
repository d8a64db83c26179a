"""What `cv2.calibrateCamera` makes of the very same detections.

Both its five-parameter and its fourteen-parameter model, with the same random halves of
every view that `lensfit.fitting.chief_ray` holds out, and the time of one calibration
with everything. OpenCV puts pixel centres at whole numbers.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from lensfit.fitting.adjust import Adjustment
from lensfit.fitting.chief_ray import ChiefRayFit
from lensfit.fitting.held_out import HELD_OUT_SEEDS
from lensfit.progress import stopwatch

_MODELS = {
    5: 0,
    14: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL,
}


@dataclass(frozen=True)
class Peer:
    """Held-out rms in pixels, and seconds of one calibration with all detections."""

    held_out_rms_px: float
    seconds: float


def opencv_of(geometry: ChiefRayFit, parameters: int) -> Peer:
    """OpenCV's 5- or 14-parameter model on the points of a fit; NaN where it fails."""
    adjustment = geometry.adjustment
    single = len(geometry.takes) == 1
    flags = _MODELS[parameters] | cv2.CALIB_USE_INTRINSIC_GUESS
    flags |= cv2.CALIB_FIX_FOCAL_LENGTH if single else 0
    with stopwatch() as spent:
        _calibrated(geometry, adjustment.used, flags)
    errors = []
    for seed in HELD_OUT_SEEDS:
        seen = np.random.default_rng(seed).random(adjustment.weight.shape) < 0.5
        errors.append(_error_px(geometry, adjustment, seen, flags))
    return Peer(float(np.mean(errors)), spent["seconds"])


def _error_px(
    geometry: ChiefRayFit, adjustment: Adjustment, seen: np.ndarray, flags: int
) -> float:
    found = _calibrated(geometry, adjustment.used & seen, flags)
    if found is None:
        return float("nan")
    matrix, distortion, rotations, translations = found
    board, observed = _marks(geometry, adjustment.used & ~seen)
    squared = []
    for b, o, rotation, translation in zip(
        board, observed, rotations, translations, strict=True
    ):
        put, _ = cv2.projectPoints(b, rotation, translation, matrix, distortion)
        squared.append(np.sum((put.reshape(-1, 2) - o) ** 2, -1))
    return float(np.sqrt(np.mean(np.concatenate(squared))))


def _calibrated(geometry: ChiefRayFit, chosen: np.ndarray, flags: int):
    """Camera matrix, distortion and poses; None if OpenCV gives up."""
    board, observed = _marks(geometry, chosen)
    first = geometry.takes[0]
    width, height = first.observations.image_size_px
    focal_px = first.focal_length_mm / first.sensor_size_mm[0] * width
    matrix = np.array(
        [[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]]
    )
    parameters = np.zeros(14 if flags & cv2.CALIB_RATIONAL_MODEL else 5)
    try:
        _, matrix, distortion, rotations, translations = cv2.calibrateCamera(
            [b.astype(np.float32)[:, None] for b in board],
            [o.astype(np.float32)[:, None] for o in observed],
            (width, height),
            matrix,
            parameters,
            flags=flags,
        )
    except cv2.error:
        return None
    return matrix, distortion, rotations, translations


def _marks(
    geometry: ChiefRayFit, chosen: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Board points and pixels of the chosen detections, view by view."""
    board, observed = [], []
    for take, mine in zip(geometry.takes, chosen, strict=True):
        detections = take.observations
        keep = mine[: len(detections)]
        place = (detections.lattice * np.asarray(take.pitch_mm))[keep]
        board.append(np.column_stack([place, np.zeros(len(place))]))
        observed.append(detections.points_px[keep] - 0.5)
    return board, observed

"""What detection reports of marks, where a test knows where they are."""

from typing import Any

import numpy as np

from lensfit.detect.observations import POINT, Observations


def found_marks(
    points_px: np.ndarray,
    image_size_px: tuple[int, int],
    *,
    deviation_px: float = 0.01,
    **known: Any,
) -> Observations:
    """Points at these places, (marks, 2), in one channel and nothing else measured.

    Parameters
    ----------
    deviation_px : Of each position in x and in y.
    known : Attributes of `Observations` that are to be others.
    """
    count = len(points_px)
    plain = {
        "lattice": np.zeros((count, 2)),
        "points_px": points_px,
        "covariance_px2": np.tile(np.eye(2) * deviation_px**2, (count, 1, 1)),
        "family": np.full(count, POINT),
        "normal": np.full((count, 2), np.nan),
        "saturated": np.zeros(count, bool),
        "overlapping": np.zeros(count, bool),
        "channel_points_px": np.full((3, count, 2), np.nan),
        "channel_covariance_px2": np.full((3, count, 2, 2), np.nan),
        "flux": np.full((count, 1), np.nan),
        "diameter_px": np.full(count, np.nan),
        "image_size_px": image_size_px,
        "candidates": count,
    }
    return Observations(**(plain | known))

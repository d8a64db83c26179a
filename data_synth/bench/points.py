"""Marks of lensfit beside those that other code found on the same photograph.

The other code's points are a file of arrays: `px` (centres of pixels at whole numbers)
and `idx`, the lattice place of each. Who is right where the two differ nobody knows; so
recall is the share of the other's points that lensfit has too, and a mark counts as
misnumbered if its place contradicts the one lattice symmetry (turn, flip, shift) under
which most marks of both agree.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from lensfit.detect.observations import Observations

_NEAR_PX = 1.0


class Agreement(NamedTuple):
    """How two detections of one photograph agree.

    Attributes
    ----------
    recall : Share of the other's points that have a mark within a pixel.
    apart_px : Median distance of those.
    misnumbered : Marks of them whose place contradicts the rest.
    more : Marks that the other lacks.
    """

    recall: float
    apart_px: float
    misnumbered: int
    more: int


def agreement(found: Observations, path: Path) -> Agreement | None:
    """Against the points in a file; None if they are of several photographs."""
    with np.load(path) as other:
        if len(np.unique(other["view"])) != 1:
            return None
        points, places = other["px"] + 0.5, other["idx"]
    queried = KDTree(found.points_px).query(points)
    apart, nearest = (np.asarray(part) for part in queried)
    near = apart < _NEAR_PX
    mine = np.asarray(found.lattice)[nearest[near]]
    return Agreement(
        recall=float(near.mean()),
        apart_px=float(np.median(apart[near])) if near.any() else float("nan"),
        misnumbered=misnumbered(mine, places[near]),
        more=len(found) - len(np.unique(nearest[near])),
    )


def misnumbered(
    mine: Int[np.ndarray, "marks 2"], other: Int[np.ndarray, "marks 2"]
) -> int:
    """Marks whose places differ under the symmetry that most agree with."""
    if not len(mine):
        return 0
    return min(_contradictions(mine @ turn, other) for turn in _symmetries())


def _contradictions(
    turned: Float[np.ndarray, "marks 2"], other: Int[np.ndarray, "marks 2"]
) -> int:
    shift = np.rint(other - turned).astype(int)
    _, counts = np.unique(shift, axis=0, return_counts=True)
    return len(turned) - int(counts.max())


def _symmetries() -> list[np.ndarray]:
    """Quarter turns and flips of a square lattice."""
    turn = np.array([[0, 1], [-1, 0]])
    turns = [np.linalg.matrix_power(turn, k) for k in range(4)]
    return turns + [one @ np.diag([1, -1]) for one in turns]

"""Nearest points in the picture, as plain arrays."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree


def nearest(
    tree: KDTree, points_px: Float[np.ndarray, "points 2"], count: int
) -> tuple[Float[np.ndarray, "points count"], Int[np.ndarray, "points count"]]:
    """Distances and indices of the nearest points of a tree, nearest first.

    Parameters
    ----------
    tree : The points to look among.
    points_px : Where to look from.
    count : How many to find; two or more, so that the result has two axes.
    """
    distance, index = tree.query(points_px, k=count)
    return np.asarray(distance), np.asarray(index)

"""Which places of a line grid are its crossings, and which lines cross there.

Print beside a grid has places that look like crossings too, some of them where the next
line would be. Those of the grid lie on one lattice and hang together by ridges.
"""

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay

from lensfit.detect.lattice import index_lattice
from lensfit.detect.ridges import RidgeScale, find_crossings
from lensfit.errors import DetectionError

FEWEST_CROSSINGS = 9
LEAST_EXPLAINED = 0.4
LEAST_JOINED = 0.6
LEAST_ATTACHED = 0.1
"""Crossings that hang together are of the grid from this part of all of them on."""
BREAK = 0.25
"""A line is broken where its ridge is weaker than this part of that at its ends."""


class Crossings(NamedTuple):
    """The numbered crossings of a grid.

    Attributes
    ----------
    points_px : Where they are.
    indices : Of the two lines that cross, from 0.
    candidates : How many places looked like one.
    """

    points_px: Float[np.ndarray, "crossings 2"]
    indices: Int[np.ndarray, "crossings 2"]
    candidates: int

    @property
    def pitch_px(self) -> float:
        """Median distance between neighbours."""
        start, end = _neighbours(self.indices)
        steps = self.points_px[end] - self.points_px[start]
        return float(np.median(np.linalg.norm(steps, axis=1)))


def numbered_crossings(
    image: Float[np.ndarray, "height width"], scale: RidgeScale, where: Path
) -> Crossings:
    """The crossings of the lines that are ridges of this scale.

    Parameters
    ----------
    image : Samples, channel units.
    where : The photograph, for what is told of a grid that was not found.

    Raises
    ------
    DetectionError : fewer than nine crossings of a connected grid were seen.
    """
    crossings, ridge = find_crossings(image, scale)
    indices, valid = index_lattice(crossings)
    indices, on_grid = indices[valid], crossings[valid]
    start, end = _neighbours(indices)
    joined = _joined(on_grid[start], on_grid[end], ridge, scale)
    share = float(joined.mean()) if len(joined) else 0.0
    attached = _attached(len(on_grid), start[joined], end[joined])
    indices, on_grid = indices[attached], on_grid[attached]
    if (
        len(on_grid) < FEWEST_CROSSINGS
        or (np.ptp(indices, axis=0) < 2).any()
        or _explained(on_grid, crossings) < LEAST_EXPLAINED
        or share < LEAST_JOINED
    ):
        colour = "bright" if scale.sign > 0 else "dark"
        raise DetectionError(
            f"no line grid found: {len(crossings)} places look like crossings of "
            f"{colour} lines, but too few lie in a grid and are joined by lines",
            where=where,
            remedy="check the target's kind and polarity, the focus and the exposure",
        )
    return Crossings(on_grid, indices - indices.min(0), len(crossings))


def _explained(on_grid: np.ndarray, crossings: np.ndarray) -> float:
    """Part of the candidates within the grid's outline that belong to it."""
    inside = Delaunay(on_grid).find_simplex(crossings) >= 0
    return len(on_grid) / max(int(inside.sum()), 1)


def _joined(
    start: np.ndarray, end: np.ndarray, ridge: np.ndarray, scale: RidgeScale
) -> Bool[np.ndarray, " pairs"]:
    """Which neighbouring crossings a ridge joins without a break."""
    if not len(start):
        return np.zeros(0, bool)
    reach = 2 * round(scale.sigma_px) + 1
    ridge = cv2.dilate(ridge, np.ones((reach, reach), np.uint8))
    fraction = np.linspace(0, 1, 11)[:, None, None]
    path = start + (end - start) * fraction
    x, y = np.moveaxis(path, -1, 0).astype(int)
    strength = ridge[y, x]
    return strength[3:-3].min(0) > BREAK * strength[[0, -1]].mean(0)


def _attached(
    count: int, start: np.ndarray, end: np.ndarray
) -> Bool[np.ndarray, " crossings"]:
    """Crossings that hang together, by ridges, with a good part of all others."""
    if not count:
        return np.zeros(0, bool)
    links = coo_matrix((np.ones(len(start)), (start, end)), (count, count))
    _, part = connected_components(links, directed=False)
    return np.bincount(part)[part] >= LEAST_ATTACHED * count


def _neighbours(indices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of crossings one step apart along i or along j."""
    at = {tuple(place): k for k, place in enumerate(indices.tolist())}
    pairs = [
        (k, at[ahead])
        for (i, j), k in at.items()
        for ahead in ((i + 1, j), (i, j + 1))
        if ahead in at
    ]
    start, end = np.array(pairs, int).reshape(-1, 2).T
    return start, end

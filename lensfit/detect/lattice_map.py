"""The smooth map from a target's lattice to the photograph, and its derivative.

A polynomial of third order in the lattice coordinates follows pose and distortion of a
flat target closely enough to tell how large, how turned and how foreshortened a cell is
anywhere on the frame. Its derivative J holds pixels per pitch: ``J[:, 0]`` along i,
``J[:, 1]`` along j.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from lensfit.detect.observations import POINT, Observations

_POWERS = [(p, q) for p in range(4) for q in range(4 - p)]
_FEWEST = 2 * len(_POWERS)
_NEWTON_STEPS = 8
"""The map is nearly affine: each squares the error."""


@final
@dataclass(frozen=True, eq=False)
class LatticeMap:
    """Pixels of lattice coordinates.

    Attributes
    ----------
    middle, half : Centre and half-width of the lattice that was seen, in pitches.
    coefficients : Of the products of powers of the scaled coordinates, per axis.
    """

    middle: Float[np.ndarray, " 2"]
    half: Float[np.ndarray, " 2"]
    coefficients: Float[np.ndarray, "terms 2"]

    def points_px(
        self, lattice: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 2"]:
        """Where lattice points are seen."""
        u, v = ((lattice - self.middle) / self.half).T
        return np.stack([u**p * v**q for p, q in _POWERS], 1) @ self.coefficients

    def jacobians_px(
        self, lattice: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, "points 2 2"]:
        """Pixels per pitch: of every point a matrix whose columns are along i and j."""
        u, v = ((lattice - self.middle) / self.half).T
        along_u = [p * u ** max(p - 1, 0) * v**q for p, q in _POWERS]
        along_v = [q * u**p * v ** max(q - 1, 0) for p, q in _POWERS]
        columns = [
            np.stack(terms, 1) @ self.coefficients / half
            for terms, half in zip((along_u, along_v), self.half, strict=True)
        ]
        return np.stack(columns, -1)

    def lattice_at(self, point_px: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " 2"]:
        """The lattice coordinates that are seen at a point of the photograph."""
        at = self.middle
        for _ in range(_NEWTON_STEPS):
            miss = point_px - self.points_px(at[None])[0]
            step = np.linalg.lstsq(self.jacobians_px(at[None])[0], miss, rcond=None)[0]
            at = at + np.clip(step, -self.half, self.half)
        return at


def lattice_map(found: Observations) -> LatticeMap | None:
    """The map of a target's detected points; None of too few of them."""
    lattice = found.lattice
    low, high = lattice.min(0), lattice.max(0)
    if len(found) < _FEWEST or (high - low < 3).any():
        return None
    middle, half = (low + high) / 2, (high - low) / 2
    u, v = ((lattice - middle) / half).T
    design = np.stack([u**p * v**q for p, q in _POWERS], 1)
    points = found.family == POINT
    if points.all():
        return LatticeMap(middle, half, _least_squares(design, found.points_px))
    # A sample of a line is known across the line only: one row of both axes at once.
    normal = np.where(points[:, None], 0.0, found.normal)
    rows = np.hstack([design * normal[:, :1], design * normal[:, 1:]])
    right = (normal * found.points_px).sum(1)
    both = _least_squares(rows, right)
    return LatticeMap(middle, half, both.reshape(2, -1).T)


def _least_squares(design: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(design, right, rcond=None)[0]

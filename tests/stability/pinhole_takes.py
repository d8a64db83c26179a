"""Marks of a flat board seen by a pinhole with Brown's radial terms; exact."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from lensfit.detect.observations import POINT, Observations
from lensfit.fit.take import Take

SENSOR_MM, IMAGE_PX, MM_PER_PX = (24.0, 18.0), (2400, 1800), 0.01
PITCH_MM, FOCAL_MM, K1 = 40.0, 30.0, -0.1
LATTICE = np.stack(np.meshgrid(np.arange(-7, 8.0), np.arange(-5, 6.0)), -1)
LATTICE = LATTICE.reshape(-1, 2)
TILTED = ((0.05, -0.35, 0.02), (0.3, 0.1, -0.03), (-0.2, 0.3, 0.05))


@dataclass(frozen=True)
class Shoot:
    """Which marks of the board are seen, from where, and how well."""

    lattice: np.ndarray
    rotations: tuple = TILTED
    noise_px: float = 0.05

    def image_px(self, view: int) -> np.ndarray:
        """Where the marks are."""
        board = np.column_stack([self.lattice * PITCH_MM, np.zeros(len(self.lattice))])
        turn = Rotation.from_rotvec(self.rotations[view])
        away = np.array([10.0 * view, -5.0 * view, 900.0 + 40.0 * view])
        seen = turn.apply(board) + away
        slope = seen[:, :2] / seen[:, 2:]
        bent = slope * (1 + K1 * (slope**2).sum(1, keepdims=True))
        return FOCAL_MM * bent / MM_PER_PX + np.array(IMAGE_PX) / 2

    def takes(self) -> list[Take]:
        """One of every view."""
        rng = np.random.default_rng(1)
        found = []
        for view in range(len(self.rotations)):
            at = self.image_px(view)
            at = at + self.noise_px * rng.normal(size=at.shape)
            found.append(take_of(at, self.lattice, f"view {view}", self.noise_px))
        return found


def take_of(at_px, lattice, name: str = "view", noise_px: float = 0.05) -> Take:
    """A photograph with marks at these places."""
    count = len(lattice)
    seen = Observations(
        lattice=np.asarray(lattice, float),
        points_px=np.asarray(at_px, float),
        covariance_px2=np.tile(np.eye(2) * max(noise_px, 1e-3) ** 2, (count, 1, 1)),
        family=np.full(count, POINT),
        normal=np.full((count, 2), np.nan),
        saturated=np.zeros(count, bool),
        overlapping=np.zeros(count, bool),
        channel_points_px=np.full((3, count, 2), np.nan),
        channel_covariance_px2=np.full((3, count, 2, 2), np.nan),
        flux=np.full((count, 1), np.nan),
        diameter_px=np.full(count, np.nan),
        image_size_px=IMAGE_PX,
        candidates=count,
    )
    return Take(
        name=name,
        target="grid",
        observations=seen,
        pitch_mm=(PITCH_MM, PITCH_MM),
        mark_diameter_mm=None,
        focal_length_mm=FOCAL_MM,
        sensor_size_mm=SENSOR_MM,
    )

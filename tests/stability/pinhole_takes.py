"""Marks of a flat board seen by a pinhole with Brown's radial terms; exact."""

from dataclasses import dataclass

import numpy as np
from found_marks import found_marks
from scipy.spatial.transform import Rotation

from lensfit.fitting.chart_view import View

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

    def takes(self) -> list[View]:
        """One of every view."""
        rng = np.random.default_rng(1)
        found = []
        for view in range(len(self.rotations)):
            at = self.image_px(view)
            at = at + self.noise_px * rng.normal(size=at.shape)
            found.append(take_of(at, self.lattice, f"view {view}", self.noise_px))
        return found


def take_of(at_px, lattice, name: str = "view", noise_px: float = 0.05) -> View:
    """A photograph with marks at these places."""
    seen = found_marks(
        np.asarray(at_px, float),
        IMAGE_PX,
        deviation_px=max(noise_px, 1e-3),
        lattice=np.asarray(lattice, float),
    )
    return View(
        name=name,
        target="grid",
        observations=seen,
        pitch_mm=(PITCH_MM, PITCH_MM),
        mark_diameter_mm=None,
        focal_length_mm=FOCAL_MM,
        sensor_size_mm=SENSOR_MM,
    )

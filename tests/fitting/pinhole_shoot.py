"""Marks photographed by a camera that shares no line with lensfit: pinhole and Brown.

A pinhole at the origin of camera axes (x right, y down, z ahead), Brown's radial and
decentering polynomials, then pixels. What is true is stated here and nowhere else.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from found_marks import found_marks
from scipy.spatial.transform import Rotation

from lensfit.detect.observations import Observations
from lensfit.fitting.chart_view import View

SENSOR_MM = (24.0, 18.0)
IMAGE_PX = (2400, 1800)
MM_PER_PX = 0.01
PITCH_MM = 40.0
LATTICE = np.stack(np.meshgrid(np.arange(-7, 8.0), np.arange(-5, 6.0)), -1).reshape(
    -1, 2
)
TILTED = ((0.05, -0.35, 0.02), (0.3, 0.1, -0.03), (-0.2, 0.3, 0.05))
"""Rotation vectors of three views that fix a focal length."""
FRONTAL = ((0.0, 0.0, 0.0), (0.01, 0.0, 0.02), (0.0, 0.01, -0.02))
STATED_FOCAL_MM = 30.0


@dataclass(frozen=True)
class Camera:
    """The truth. Radial coefficients act on radii in principal distances."""

    focal_length_mm: float = 30.6
    centre_mm: tuple[float, float] = (0.12, -0.08)
    k: tuple[float, float] = (0.0, 0.0)
    p: tuple[float, float] = (0.0, 0.0)
    warp_mm: float = 0.0
    rotations: tuple = field(default=TILTED)
    distance_mm: float = 900.0

    def image_mm(self, points_mm: np.ndarray) -> np.ndarray:
        """Sensor mm of points in camera axes."""
        x, y = (points_mm[:, :2] / points_mm[:, 2:]).T
        r2 = x * x + y * y
        k1, k2 = self.k
        p1, p2 = self.p
        radial = 1 + r2 * (k1 + r2 * k2)
        x_d = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        y_d = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        image = self.focal_length_mm * np.stack([x_d, y_d], -1) + self.centre_mm
        u, v = (image / [12.0, 9.0]).T
        ripple = np.stack([np.sin(2.5 * v) * u * u, np.sin(2.2 * u + 0.5) * v], -1)
        return image + self.warp_mm * ripple

    def camera_axes(self, view: int, board_mm: np.ndarray) -> np.ndarray:
        """Marks of the flat board in the camera axes of one view."""
        flat = np.concatenate([board_mm, np.zeros((len(board_mm), 1))], -1)
        turn = Rotation.from_rotvec(self.rotations[view])
        middle = [10.0 * view, -5.0 * view, self.distance_mm + 40.0 * view]
        return turn.apply(flat) + middle

    def marks_mm(self, view: int) -> np.ndarray:
        """Sensor mm of every mark of the lattice in one view."""
        return self.image_mm(self.camera_axes(view, LATTICE * PITCH_MM))


def observations(
    image_mm: np.ndarray, noise_px: float = 0.0, seed: int = 0, lattice=LATTICE
) -> Observations:
    """What detection would report of marks at these places."""
    noise = np.random.default_rng(seed).normal(0, 1, image_mm.shape) * noise_px
    middle = np.asarray(IMAGE_PX) / 2
    return found_marks(
        image_mm / MM_PER_PX + middle + noise,
        IMAGE_PX,
        deviation_px=max(noise_px, 1e-3),
        lattice=np.asarray(lattice, float),
    )


def take_of(seen: Observations, name: str = "view", **changes) -> View:
    """A photograph of the lattice with what its slate would say."""
    stated = View(
        name=name,
        target="grid",
        observations=seen,
        pitch_mm=(PITCH_MM, PITCH_MM),
        mark_diameter_mm=None,
        focal_length_mm=STATED_FOCAL_MM,
        sensor_size_mm=SENSOR_MM,
    )
    return replace(stated, **changes)


def shoot(
    camera: Camera, noise_px: float = 0.0, seed: int = 0, **changes
) -> list[View]:
    """One take of every view of the camera."""
    return [
        take_of(
            observations(camera.marks_mm(k), noise_px, 1000 * seed + k),
            f"view {k}",
            **changes,
        )
        for k in range(len(camera.rotations))
    ]

"""OpenCV's camera: a matrix in pixels and up to fourteen distortion coefficients.

With x, y the direction X/Z, Y/Z of a point (x right, y down):

    x'' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
          + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4

and y'' with p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4, then for a tilted sensor the
homography of tau_x, tau_y; the pixel is K (x'', y'', 1). The order of a file is
k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y. Integers are pixel centres there:
lensfit's position is half a pixel more, and so is the principal point.

Source: OpenCV's documentation of the camera calibration module.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from lensfit.preset.exchange.foreign import Points
from lensfit.preset.exchange.inverse import inverted

COUNTS = (4, 5, 8, 12, 14)
"""How many coefficients a file may hold."""


def opencv_distorted(
    directions: Points, coefficients: Float[np.ndarray, "14"]
) -> Points:
    """x'', y'' of directions X/Z, Y/Z."""
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y = coefficients
    x, y = directions[:, 0], directions[:, 1]
    r2 = x * x + y * y
    r4 = r2 * r2
    ratio = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (
        1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    )
    bent = np.stack(
        [
            x * ratio + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + s1 * r2 + s2 * r4,
            y * ratio + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + s3 * r2 + s4 * r4,
        ],
        -1,
    )
    return bent if not (tau_x or tau_y) else _tilted(bent, tau_x, tau_y)


def _tilted(points: Points, tau_x: float, tau_y: float) -> Points:
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    turned = about_y @ about_x
    onto = np.array(
        [[turned[2, 2], 0, -turned[0, 2]], [0, turned[2, 2], -turned[1, 2]], [0, 0, 1]]
    )
    landed = np.column_stack([points, np.ones(len(points))]) @ (onto @ turned).T
    return landed[:, :2] / landed[:, 2:]


@final
@dataclass(frozen=True, eq=False)
class OpenCvMap:
    """The camera over a sensor of known size.

    Attributes
    ----------
    matrix : K, pixels.
    coefficients : All fourteen.
    size_px : Width and height of the picture.
    pitch_mm : Of its square pixels.
    """

    matrix: Float[np.ndarray, "3 3"]
    coefficients: Float[np.ndarray, "14"]
    size_px: tuple[int, int]
    pitch_mm: float

    @property
    def principal_distance_mm(self) -> float:
        """Geometric mean of both axes."""
        return float(np.sqrt(self.matrix[0, 0] * self.matrix[1, 1])) * self.pitch_mm

    @property
    def principal_point_mm(self) -> tuple[float, float]:
        """From the sensor centre."""
        point = self._mm(self.matrix[None, :2, 2])[0]
        return float(point[0]), float(point[1])

    def distorted(self, undistorted_mm: Points) -> Points:
        """The closed form."""
        about = np.asarray(undistorted_mm, float) - np.array(self.principal_point_mm)
        bent = opencv_distorted(about / self.principal_distance_mm, self.coefficients)
        return self._mm(bent @ self.matrix[:2, :2].T + self.matrix[:2, 2])

    def undistorted(self, distorted_mm: Points) -> Points:
        """The inverse; NaN where there is none."""
        unit = self.pitch_mm * float(np.hypot(*self.size_px)) / 2
        return inverted(self.distorted, distorted_mm, unit)

    def _mm(self, pixels: Points) -> Points:
        half = np.array(self.size_px, float) / 2
        return (pixels + 0.5 - half) * self.pitch_mm

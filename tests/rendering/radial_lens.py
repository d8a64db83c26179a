"""A lens in closed form, with the methods that the renderer uses."""

import numpy as np


class RadialLens:
    """Undistorted = distorted * (1 + k r^2), r in units of the half diagonal.

    Red and blue are magnified by 1 + lateral and 1 - lateral; the fall-off is
    1 / (1 + drop r^2). Beyond `valid_radius` there is no inverse.
    """

    sensor_size_mm = (36.0, 24.0)
    focal_length_mm = 35.0
    f_number = 2.8
    focus_distance_mm = 2000.0

    def __init__(self, k=0.05, lateral=0.0, drop=0.0, valid_radius=np.inf):
        self.k, self.lateral, self.drop = k, lateral, drop
        self.valid_radius = valid_radius
        self.half_diagonal_mm = np.hypot(*self.sensor_size_mm) / 2

    @property
    def has_lateral_colour(self):
        return self.lateral != 0

    def _magnification(self, channel):
        return 1 + {"r": 1, "g": 0, "b": -1}[channel] * self.lateral

    def _square(self, points_mm):
        return np.sum((points_mm / self.half_diagonal_mm) ** 2, -1, keepdims=True)

    def undistorted_from_distorted(self, points_mm, channel="g"):
        green = np.asarray(points_mm) / self._magnification(channel)
        square = self._square(green)
        result = green * (1 + self.k * square)
        return np.where(square <= self.valid_radius**2, result, np.nan)

    def distorted_from_undistorted(self, points_mm, channel="g"):
        points_mm = np.asarray(points_mm)
        scale = np.ones((len(points_mm), 1))
        for _ in range(80):
            scale = 1 / (1 + self.k * self._square(points_mm * scale))
        return points_mm * scale * self._magnification(channel)

    def relative_illumination(self, points_mm, channel="g"):
        return 1 / (1 + self.drop * self._square(np.asarray(points_mm))[:, 0])


class IdentityLens(RadialLens):
    """No distortion at all."""

    def __init__(self):
        super().__init__(k=0.0)

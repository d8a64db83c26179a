"""The distortion of OpenLensIO: Brown and Conrady's, as a ratio of polynomials.

With x, y in millimetres from the centre of distortion, x right, y down:

    R  = (1 + k1 r^2 + k3 r^4 + k5 r^6) / (1 + k2 r^2 + k4 r^4 + k6 r^6)
    x' = R x + 2 p1 x y + p2 (r^2 + 2 x^2)
    y' = R y + 2 p2 x y + p1 (r^2 + 2 y^2)

Odd coefficients are the numerator's, even ones the denominator's; their units are
mm^-2, mm^-4 and mm^-6, that of p1 and p2 is mm^-1. "D-U" leads from distorted to
undistorted, "U-D" back; each is a closed form in its own direction only. Both pictures
share the centre dP + dC: the projection offset and, from it, the distortion offset.

Source: OpenLensIO 1.0.1, eq. 4 (eq. 8 leaves the "+ dC + dP" out).
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from lensfit.preset.exchange.foreign import Points
from lensfit.preset.exchange.inverse import inverted

D_U = "Brown-Conrady D-U"
U_D = "Brown-Conrady U-D"


def brown_conrady(
    points: Points, radial: tuple[float, ...], tangential: tuple[float, ...]
) -> Points:
    """x', y' of the module docstring, about the origin; what is missing is zero."""
    k = np.zeros(6)
    k[: len(radial)] = radial
    p1, p2 = (*tangential, 0.0, 0.0)[:2]
    x, y = points[:, 0], points[:, 1]
    r2 = x * x + y * y
    above = 1 + r2 * (k[0] + r2 * (k[2] + r2 * k[4]))
    below = 1 + r2 * (k[1] + r2 * (k[3] + r2 * k[5]))
    ratio = above / below
    return np.stack(
        [
            ratio * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            ratio * y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
        ],
        -1,
    )


@final
@dataclass(frozen=True, eq=False)
class BrownMap:
    """The model with its numbers.

    Attributes
    ----------
    model : `D_U` or `U_D`.
    radial : k1 ... k6, interleaved, as many as are known.
    tangential : p1, p2, or nothing.
    centre_mm : Of distortion, on the sensor.
    unit_mm : Size of the picture: the inverse is exact to 1e-12 of it.
    """

    model: str
    radial: tuple[float, ...]
    tangential: tuple[float, ...]
    centre_mm: tuple[float, float]
    unit_mm: float

    def undistorted(self, distorted_mm: Points) -> Points:
        """Closed form of "D-U"; NaN where "U-D" has no inverse."""
        if self.model == D_U:
            return self._closed(distorted_mm)
        return inverted(self._closed, distorted_mm, self.unit_mm)

    def distorted(self, undistorted_mm: Points) -> Points:
        """Closed form of "U-D"; NaN where "D-U" has no inverse."""
        if self.model == U_D:
            return self._closed(undistorted_mm)
        return inverted(self._closed, undistorted_mm, self.unit_mm)

    def _closed(self, points_mm: Points) -> Points:
        centre = np.array(self.centre_mm)
        about = np.asarray(points_mm, float) - centre
        return brown_conrady(about, self.radial, self.tangential) + centre

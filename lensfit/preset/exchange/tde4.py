"""The distortion models of 3DEqualizer that compositors use most.

Closed form from distorted to undistorted. A point counts from the lens centre, y up, in
half diagonals of the filmback; the models are then

    radial:      p' = p (1 + c2 r^2 + c4 r^4) + decentering,   p_u = M p'
    anamorphic:  p_u = R Sx Sy [Z] P  A  R^-1 [Z^-1] P^-1  p_d

with M the cylindric bending by b along azimuth phi (determinant one), R the rotation of
the lens, Sx, Sy the squeezes, P the pixel aspect, Z the rescale (both stretch x) and

    A:  x' = x (1 + sum over n = 2, 4 and even k <= n of c_kn r^n cos(k theta)),

y' the same with its own coefficients. Knobs of the Nuke nodes are named as the model's
parameters, with an underscore for everything that is no letter or digit.

Source: Lens Distortion Plugin Kit 2.12 (Science-D-Visions); the tests hold its values.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Float

from lensfit.preset.exchange.foreign import Points
from lensfit.preset.exchange.inverse import inverted

RADIAL = "LD_3DE4_Radial_Standard_Degree_4"
ANAMORPHIC = "LD_3DE4_Anamorphic_Standard_Degree_4"
RESCALED = "LD_3DE4_Anamorphic_Rescaled_Degree_4"

_RADIAL_KNOBS = {
    "Distortion_Degree_2": 0.0,
    "U_Degree_2": 0.0,
    "V_Degree_2": 0.0,
    "Quartic_Distortion_Degree_4": 0.0,
    "U_Degree_4": 0.0,
    "V_Degree_4": 0.0,
    "Phi_Cylindric_Direction": 0.0,
    "B_Cylindric_Bending": 0.0,
}
_ANAMORPHIC_KNOBS = {
    f"C{axis}{term}_Degree_{term[1]}": 0.0
    for term in ("02", "22", "04", "24", "44")
    for axis in "xy"
} | {"Lens_Rotation": 0.0, "Squeeze_X": 1.0, "Squeeze_Y": 1.0}

KNOBS: dict[str, dict[str, float]] = {
    RADIAL: _RADIAL_KNOBS,
    ANAMORPHIC: _ANAMORPHIC_KNOBS,
    RESCALED: _ANAMORPHIC_KNOBS | {"Rescale": 1.0},
}
"""The parameters of each model, in their order, with their defaults."""


@final
@dataclass(frozen=True, eq=False)
class Tde4Map:
    """One model with its numbers.

    Attributes
    ----------
    model : A key of `KNOBS`, the name of the Nuke node.
    knobs : Parameters by knob; what is left out has its default.
    filmback_mm : Width and height.
    centre_mm : Of the lens, from the filmback's centre, x right, y down.
    """

    model: str
    knobs: Mapping[str, float]
    filmback_mm: tuple[float, float]
    centre_mm: tuple[float, float] = (0.0, 0.0)
    pixel_aspect: float = 1.0
    _half_diagonal_mm: float = field(init=False)

    def __post_init__(self):
        unknown = set(self.knobs) - set(KNOBS[self.model])
        if unknown:
            raise ValueError(f"{self.model} has no {', '.join(sorted(unknown))}")
        object.__setattr__(
            self, "_half_diagonal_mm", float(np.hypot(*self.filmback_mm)) / 2
        )

    def undistorted(self, distorted_mm: Points) -> Points:
        """The closed form."""
        flip = np.array([1.0, -1.0]) * self._half_diagonal_mm
        p = (np.asarray(distorted_mm, float) - np.array(self.centre_mm)) / flip
        values = list((KNOBS[self.model] | dict(self.knobs)).values())
        if self.model == RADIAL:
            q = radial_standard(p, np.array(values))
        else:
            q = anamorphic(p, np.array(values), self.pixel_aspect)
        return q * flip + np.array(self.centre_mm)

    def distorted(self, undistorted_mm: Points) -> Points:
        """The inverse; NaN where the model has none."""
        return inverted(self.undistorted, undistorted_mm, self._half_diagonal_mm)


def radial_standard(p: Points, values: Float[np.ndarray, "8"]) -> Points:
    """Radial - Standard, Degree 4; `values` in the order of its knobs."""
    c2, u1, v1, c4, u3, v3, phi, bending = values
    x, y = p[:, 0], p[:, 1]
    r2 = x * x + y * y
    gain = 1 + r2 * (c2 + c4 * r2)
    u, v = u1 + u3 * r2, v1 + v3 * r2
    q = np.stack(
        [
            x * gain + (r2 + 2 * x * x) * u + 2 * x * y * v,
            y * gain + (r2 + 2 * y * y) * v + 2 * x * y * u,
        ],
        -1,
    )
    root = np.sqrt(1 + bending)
    rotation = _rotation(phi)
    return q @ (rotation @ np.diag([root, 1 / root]) @ rotation.T).T


def anamorphic(
    p: Points, values: Float[np.ndarray, " values"], pixel_aspect: float = 1.0
) -> Points:
    """Anamorphic - Standard (13 values) or Rescaled (14), Degree 4, in their order."""
    rotation, stretch = _rotation(values[10]), np.diag([pixel_aspect, 1.0])
    if len(values) > 13:
        stretch = np.diag([values[13], 1.0]) @ stretch
    squeeze = np.diag([values[11], values[12]])
    inside = p @ np.linalg.inv(stretch @ rotation).T
    x2, y2 = inside[:, 0] ** 2, inside[:, 1] ** 2
    r2, second = x2 + y2, x2 - y2
    fourth = x2 * x2 - 6 * x2 * y2 + y2 * y2
    shapes = np.stack([r2, second, r2 * r2, r2 * second, fourth], -1)
    bent = inside * (1 + shapes @ values[:10].reshape(5, 2))
    return bent @ (rotation @ squeeze @ stretch).T


def _rotation(degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])

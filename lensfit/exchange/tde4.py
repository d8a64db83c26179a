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

Fitted to a lens, lens centre and filmback are the lens' own, and the pixel aspect is 1:
a squeeze goes to the squeezes of the model (for the radial one to its cylindric
bending), so that the undistorted picture is the lens' own too. Rotation and squeeze
start from the slope at the centre. The rotation, which means nothing to a round lens,
and the rescale, which is nearly collinear with the rest, move only where that makes the
residual noticeably smaller.

Source: Lens Distortion Plugin Kit 2.12 (Science-D-Visions); the tests hold its values.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from jaxtyping import Float

from lensfit.exchange.foreign import Points, inverse_points
from lensfit.exchange.samples import Samples, fit_undistorting

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
        return inverse_points(self.undistorted, undistorted_mm, self._half_diagonal_mm)


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


_ROUND = 1e-3
"""Squeeze that has no direction yet."""
_WORTH = 0.8
_NOTHING_PX = 1e-7


def fit_tde4(model: str, samples: Samples, centre_mm: tuple[float, float]) -> Tde4Map:
    """The model with the values that suit the samples best.

    Parameters
    ----------
    model : A key of `KNOBS`.
    centre_mm : The lens' principal point.
    """
    plain = Tde4Map(model, {}, samples.frame.area_mm, centre_mm)
    angle_deg, along, across = _stretch(samples, centre_mm)
    if model == RADIAL:
        start = [0.0] * 6 + [angle_deg, along / across - 1]
        return _fit_knobs(plain, start, samples)
    start = [0.0] * 10 + [angle_deg, along, across]
    upright = _fit_knobs(plain, start, samples, held=("Lens_Rotation", "Rescale"))
    found = [upright, _fit_knobs(plain, start, samples, held=("Rescale",))]
    if model == RESCALED:
        for scale in dict.fromkeys((1.0, along / across, across / along)):
            found.append(_fit_knobs(plain, [*start, scale], samples))
    return _simplest(found, samples)


def _fit_knobs(
    plain: Tde4Map, start: list[float], samples: Samples, held: tuple[str, ...] = ()
) -> Tde4Map:
    names = list(KNOBS[plain.model])[: len(start)]
    free = np.array([name not in held for name in names])

    def at(values: np.ndarray) -> Tde4Map:
        whole = np.array(start)
        whole[free] = values
        return replace(plain, knobs=dict(zip(names, whole.tolist(), strict=True)))

    values = fit_undistorting(
        lambda v, points: at(v).undistorted(points), np.array(start)[free], samples
    )
    return _tidy(at(values))


def _simplest(found: list[Tde4Map], samples: Samples) -> Tde4Map:
    """The first after which none is noticeably nearer."""
    best = found[0]
    for one in found[1:]:
        size = _off(best, samples)
        if size > _NOTHING_PX and _off(one, samples) < _WORTH * size:
            best = one
    return best


def _tidy(model: Tde4Map) -> Tde4Map:
    """The same with angles within half a turn; none where nothing points anywhere."""
    knobs = dict(model.knobs)
    for name in ("Phi_Cylindric_Direction", "Lens_Rotation"):
        if name in knobs:
            knobs[name] = (knobs[name] + 90) % 180 - 90
    return replace(model, knobs=knobs)


def _off(model: Tde4Map, samples: Samples) -> float:
    """Root mean square of the undistorted positions, px."""
    off = model.undistorted(samples.distorted_mm) - samples.undistorted_mm
    square = float(np.mean(np.sum(off**2, -1)))
    return math.sqrt(square) / samples.frame.pitch_mm if square >= 0 else math.inf


def _stretch(
    samples: Samples, centre_mm: tuple[float, float]
) -> tuple[float, float, float]:
    """Azimuth (degrees, y up) of the axis nearest x, stretch along and across it."""
    distance = np.linalg.norm(samples.distorted_mm - np.array(centre_mm), axis=-1)
    flip = np.diag([1.0, -1.0])
    slope = flip @ samples.slope[int(distance.argmin())] @ flip
    sizes, axes = np.linalg.eigh((slope + slope.T) / 2)
    if sizes[1] / sizes[0] - 1 < _ROUND:
        return 0.0, 1.0, 1.0
    nearest = int(np.abs(axes[0]).argmax())
    x, y = axes[:, nearest] * np.sign(axes[0, nearest])
    angle = float(np.degrees(np.arctan2(y, x)))
    return angle, float(sizes[nearest]), float(sizes[1 - nearest])

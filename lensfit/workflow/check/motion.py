"""Detect motion of camera or chart during the exposure, as blur uniform in the frame.

A uniform motion of L pixels along a unit vector u adds ``L^2/12 u u'`` to the second
moments of every point's image. The lens' own blur changes with the field and is, for a
centred lens, symmetric about the radius: defocus and field curvature add the same in
all directions, astigmatism along and across the radius. So the variance along n at
field point p is fitted with

    isotropic polynomial of p  +  (a r^2 + b r^4) cos 2(n, p)  +  m1 cos 2n + m2 sin 2n,

and the last two terms, which no centred lens has, are motion.
"""

import math
from dataclasses import dataclass
from typing import final

import numpy as np

from lensfit.detect.directional_blur import DirectionalBlur

_LEAST_LENGTH_PX = 1.5
_LEAST_DEVIATIONS = 6.0
_LEAST_SHARE = 0.15
"""Of the usual variance of the blur that the difference along and across must be."""
_ROUNDS = 4
_HUBER = 1.5


@final
@dataclass(frozen=True)
class Motion:
    """What moved.

    Attributes
    ----------
    moved : Whether the photograph shows it.
    length_px : Of a uniform motion that spreads light as much; of one that is not
        there, what the photograph could hide.
    direction_deg : From x to the right towards y down, in [0, 180).
    """

    moved: bool
    length_px: float
    direction_deg: float

    @property
    def way(self) -> str:
        """The direction in words."""
        ways = ("horizontally", "diagonally, falling to the right", "vertically",
                "diagonally, rising to the right")  # fmt: skip
        return ways[round(self.direction_deg / 45) % 4]


def motion_of(blur: DirectionalBlur, image_size_px: tuple[int, int]) -> Motion | None:
    """The uniform part of the blur that depends on direction; None of too few samples.

    Parameters
    ----------
    blur : Of an exposure through a lens that is not anamorphic, whose blur has an axis
        of its own.
    """
    design = _design(blur, image_size_px)
    if len(design) < 4 * design.shape[1]:
        return None
    values = blur.variance_px2
    weight = np.ones(len(values))
    solution = np.zeros(design.shape[1])
    spread = 1.0
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
        left = values - design @ solution
        spread = max(1.4826 * float(np.median(np.abs(left))), 1e-9)
        weight = np.minimum(1.0, _HUBER * spread / np.maximum(np.abs(left), 1e-12))
    normal = design.T @ (design * weight[:, None])
    covariance = np.linalg.pinv(normal) * spread**2
    m1, m2 = solution[-2:]
    amplitude = float(np.hypot(m1, m2))
    deviation = math.sqrt(max(np.trace(covariance[-2:, -2:]) / 2, 1e-12))
    length = math.sqrt(24 * amplitude)
    hidden = max(_LEAST_LENGTH_PX, math.sqrt(24 * _LEAST_DEVIATIONS * deviation))
    moved = (
        length > _LEAST_LENGTH_PX
        and amplitude > _LEAST_DEVIATIONS * deviation
        and 2 * amplitude > _LEAST_SHARE * float(np.median(values))
    )
    direction = math.degrees(0.5 * math.atan2(m2, m1)) % 180
    return Motion(moved, length if moved else hidden, direction)


def _design(blur: DirectionalBlur, image_size_px: tuple[int, int]) -> np.ndarray:
    size = np.asarray(image_size_px, float)
    place = (blur.points_px - size / 2) / (np.linalg.norm(size) / 2)
    x, y = place.T
    r2 = x * x + y * y
    n = blur.direction
    twice = np.stack([n[:, 0] ** 2 - n[:, 1] ** 2, 2 * n[:, 0] * n[:, 1]], -1)
    # r^2 cos 2(angle between n and p), without dividing by r
    radial = (x * x - y * y) * twice[:, 0] + 2 * x * y * twice[:, 1]
    one = np.ones_like(x)
    isotropic = [one, x, y, x * x, x * y, y * y, x * r2, y * r2, r2 * r2]
    return np.stack([*isotropic, radial, r2 * radial, *twice.T], 1)

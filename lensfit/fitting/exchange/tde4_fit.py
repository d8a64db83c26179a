"""3DEqualizer's models fitted to a lens.

Lens centre and filmback are the lens' own, and the pixel aspect is 1: a squeeze goes to
the squeezes of the model (for the radial one to its cylindric bending), so that the
undistorted picture is the lens' own too. Rotation and squeeze start from the slope at
the centre. The rotation, which means nothing to a round lens, and the rescale, which
can hardly be told from the rest, move only where that makes the residual noticeably
smaller.
"""

import math
from dataclasses import replace

import numpy as np

from lensfit.fitting.exchange.closed_form import fit_undistorting
from lensfit.fitting.exchange.samples import Samples
from lensfit.preset.exchange.tde4 import KNOBS, RADIAL, RESCALED, Tde4Map

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
        return _fitted(plain, start, samples)
    start = [0.0] * 10 + [angle_deg, along, across]
    upright = _fitted(plain, start, samples, held=("Lens_Rotation", "Rescale"))
    found = [upright, _fitted(plain, start, samples, held=("Rescale",))]
    if model == RESCALED:
        for scale in dict.fromkeys((1.0, along / across, across / along)):
            found.append(_fitted(plain, [*start, scale], samples))
    return _simplest(found, samples)


def _fitted(
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

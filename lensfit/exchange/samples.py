"""A lens sampled over a frame, and how far another model of it is off, in pixels.

The residual is measured on the photograph: a point of the frame (and its overscan) is
undistorted by the lens and put back by the other model; how far it lands from where it
was is the error that a compositor sees between plate and CG. Coefficients of a closed
form are found by least squares of the same: errors of an undistorted position are
brought to the photograph by the lens' own slope there, so that all models minimise the
same pixels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from lensfit.batches import in_batches
from lensfit.coords import mm_from_px, px_from_mm
from lensfit.errors import ExchangeError
from lensfit.exchange.foreign import PointMap, Points, is_folded

if TYPE_CHECKING:
    from lensfit.lens import Lens


FIT_COUNT = 33
JUDGE_COUNT = 97
"""Positions across the frame; their spacing differs, so that one judges the other."""
_MOST_ROWS = 3
"""Times the columns: a strip is no frame, but it must come to an end."""
_STEP = 1e-5
_FLATTEST = 1e-9
"""Area of the undistorted picture, of that of the photograph, that still is one."""


@dataclass(frozen=True)
class ExchangeFrame:
    """The picture over which models are compared.

    Attributes
    ----------
    size_px : Of the frame, square pixels.
    sensor_width_mm : Width that the frame spans.
    overscan_percent : In total beyond the frame, as plates state it.
    """

    size_px: tuple[int, int]
    sensor_width_mm: float
    overscan_percent: float = 0.0

    @property
    def pitch_mm(self) -> float:
        """Width and height of a pixel."""
        return self.sensor_width_mm / self.size_px[0]

    @property
    def area_mm(self) -> tuple[float, float]:
        """Width and height of the frame on the sensor."""
        return self.sensor_width_mm, self.size_px[1] * self.pitch_mm

    @property
    def radius_mm(self) -> float:
        """Half diagonal, without the overscan."""
        return float(np.hypot(*self.area_mm)) / 2

    def grid_mm(self, count: int) -> Points:
        """`count` positions across, and as dense down, border included."""
        width, height = self.size_px
        margin = self.overscan_percent / 200
        rows = min(max(3, round(count * height / width)), _MOST_ROWS * count)
        x = np.linspace(-margin * width, (1 + margin) * width, count)
        y = np.linspace(-margin * height, (1 + margin) * height, rows)
        return self.mm(np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))

    def mm(self, points_px: Points) -> Points:
        """Sensor mm of pixels."""
        return mm_from_px(points_px, self.size_px, self.area_mm)

    def px(self, points_mm: Points) -> Points:
        """Pixels of sensor mm."""
        return px_from_mm(points_mm, self.size_px, self.area_mm)

    def __str__(self) -> str:
        size = f"{self.size_px[0]} x {self.size_px[1]}"
        over = self.overscan_percent
        return f"{size} + {over:g} %" if over else size


class Residual(NamedTuple):
    """How far two models of a lens are apart on the photograph, px."""

    rms_px: float
    worst_px: float

    def __str__(self) -> str:
        return f"rms {self.rms_px:.2g} px, worst {self.worst_px:.2g} px"


@dataclass(frozen=True, eq=False)
class LensMap:
    """A lens of lensfit as other models are: one channel, NumPy in and out."""

    lens: "Lens"
    channel: Literal["r", "g", "b"] = "g"

    def distorted(self, undistorted_mm: Points) -> Points:
        """Where points of the undistorted picture land on the photograph."""

        def one(points):
            return self.lens.distorted_from_undistorted(points, self.channel)

        return in_batches(one, undistorted_mm)

    def undistorted(self, distorted_mm: Points) -> Points:
        """The inverse."""

        def one(points):
            return self.lens.undistorted_from_distorted(points, self.channel)

        return in_batches(one, distorted_mm)


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of a frame, on the photograph and undistorted.

    Attributes
    ----------
    slope : d undistorted / d distorted at each point.
    """

    frame: ExchangeFrame
    distorted_mm: Points
    undistorted_mm: Points
    slope: Float[np.ndarray, "points 2 2"]

    @classmethod
    def of(
        cls, lens: PointMap, frame: ExchangeFrame, count: int = FIT_COUNT
    ) -> "Samples":
        """A lens over a frame.

        Raises
        ------
        ExchangeError : The lens sees 90 degrees and more off axis there: no
            undistorted picture holds that.
        """
        distorted = frame.grid_mm(count)
        undistorted = lens.undistorted(distorted)
        h = _STEP * frame.radius_mm
        columns = [
            (lens.undistorted(distorted + h * e) - lens.undistorted(distorted - h * e))
            / (2 * h)
            for e in np.eye(2)
        ]
        slope = np.stack(columns, -1)
        with np.errstate(all="ignore"):
            upright = bool((np.linalg.det(slope) > _FLATTEST).all())
        if not (np.isfinite(undistorted).all() and upright):
            raise ExchangeError(
                "the lens has no undistorted picture of the whole frame: it sees 90 "
                "degrees off axis, or folds",
                where=str(frame),
                remedy="use less overscan, or UV maps, which may have holes",
            )
        return cls(frame, distorted, undistorted, slope)


def residual_of(model: PointMap, samples: Samples) -> Residual:
    """How far `model` puts the samples from where they are.

    Raises
    ------
    ExchangeError : The model folds over the frame, or is undefined there.
    """
    landed = model.distorted(samples.undistorted_mm)
    folded = is_folded(model.distorted, samples.undistorted_mm, samples.frame.radius_mm)
    if folded or not np.isfinite(landed).all():
        raise ExchangeError(
            "the other model turns over inside the frame, so that it cannot be undone",
            where=str(samples.frame),
            remedy="use less overscan, another model, or UV maps",
        )
    off = np.linalg.norm(landed - samples.distorted_mm, axis=-1)
    return residual_from(off / samples.frame.pitch_mm)


def residual_from(off_px: Float[np.ndarray, " points"]) -> Residual:
    """The figures of distances."""
    return Residual(float(np.sqrt(np.mean(off_px**2))), float(off_px.max()))


Vector = Float[np.ndarray, " values"]
_BEYOND = 1e8
"""Pixels, in place of what is not a number."""
_MOST_CALLS = 4000


def fit_undistorting(
    closed: Callable[[Vector, Points], Points], start: Vector, samples: Samples
) -> Vector:
    """Values with which `closed` takes distorted to undistorted mm."""
    inverse = np.linalg.inv(samples.slope) / samples.frame.pitch_mm

    def off_px(values: Vector) -> np.ndarray:
        off = closed(values, samples.distorted_mm) - samples.undistorted_mm
        return np.einsum("nij,nj->ni", inverse, off)

    return _least(off_px, start)


def fit_distorting(
    closed: Callable[[Vector, Points], Points], start: Vector, samples: Samples
) -> Vector:
    """Values with which `closed` takes undistorted to distorted mm."""

    def off_px(values: Vector) -> np.ndarray:
        off = closed(values, samples.undistorted_mm) - samples.distorted_mm
        return off / samples.frame.pitch_mm

    return _least(off_px, start)


def _least(off_px: Callable[[Vector], np.ndarray], start: Vector) -> Vector:
    def bounded(values: Vector) -> np.ndarray:
        off = np.nan_to_num(off_px(values).ravel(), nan=_BEYOND, posinf=_BEYOND)
        return np.clip(off, -_BEYOND, _BEYOND)

    with np.errstate(all="ignore"):
        found = least_squares(
            bounded,
            np.asarray(start, float),
            method="lm",
            x_scale="jac",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
            max_nfev=_MOST_CALLS,
        )
    return found.x

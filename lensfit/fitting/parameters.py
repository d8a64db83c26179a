"""The parameters of the geometric fit: one flat vector of named blocks.

Parameters are dimensionless, in units of the reference radius on the sensor or of half
a board, so that a unit of any of them moves image points by a comparable amount. Blocks
that describe the lens or the board come first and are shared by all photographs. For
each photograph there follow six parameters of the pose, two of the drift of a rolling
shutter (shift of a row per unit of its height), and the bend of the board out of its
plane. The bend is not shared, because paper and plates bend differently whenever they
are moved, and because a cropped grid may show any part of the board.

A block is fixed or freed by its prior: fixed means a standard deviation of zero.

Loose priors keep parameters that the photographs do not determine from diverging, and
have little effect on the others. The principal point stays well inside the frame. Thin
prism resembles decentering with a tilt of the chart and is small: less than 2e-4 in
three designs with elements out of centre by manufacturing tolerances, whose decentering
was up to 1e-3.

A centroid bias proportional to the distance from the axis, as coma causes it, looks
like a chart at another distance; a bias of one or two pixels at the edge is large. The
bias by clipping starts farther out and has a distinct form.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from lensfit.optics import field
from lensfit.optics.projection import BaseProjection

POSE_PARAMETERS = 6
DRIFT_PARAMETERS = 2
LOWEST_BEND_DEGREE = 2
_STATED = ("focal_length", "pupil_offset")
PINHOLE = ("pupil_gap", "principal_point")
"""Blocks that only views from several sides determine."""
APERTURE_SHIFT_TERMS = 3
LOOSE = {
    "focal_length": 1.0,
    "pupil_offset": 100.0,
    "pupil_gap": 2.0,
    "pupil_shift": 3.0,
    "principal_point": 0.05,
    "radial": 1.0,
    "squeeze": 0.1,
    "decentering": 0.05,
    "thin_prism": 3e-4,
    "anamorphic": 0.05,
    "free_field": 0.01,
    "board_stretch": 0.01,
    "aperture_shift": (0.001, 0.01, 0.01),
    "pose": 3.0,
    "row_drift": 0.005,
    "board_bend": 0.01,
}
"""Standard deviations in the units of `parameters`: reference radii, half boards, for a
pose radians and distances, and for the offset, gap and shift of pupils focal lengths.
`lensfit.fitting.statements` hold the first two."""


def stated_blocks(pupil_shift_free: bool) -> tuple[str, ...]:
    """Blocks that statements hold where photographs do not determine them, always free;
    the shift of the pupil only where photographs can show it."""
    return (*_STATED, "pupil_shift") if pupil_shift_free else _STATED


@dataclass(frozen=True)
class Layout:
    """Which blocks exist and how long they are; static, so one program per layout.

    Attributes
    ----------
    base : Ideal projection.
    radial : Number of radial coefficients.
    free_degree : Degree of the free field; 0 for none.
    bend_degree : Degree of the board's bend out of its plane, one for each photograph;
        0 for none.
    stretch_degree : Degree of the board's errors within its plane, shared by the
        photographs that show the whole board; 0 for none.
    apertures : Number of f-numbers besides the smallest aperture.
    anamorphic : Whether x and y have an entrance pupil each, a gap apart; the pupil of
        others shifts along the axis with field angle.
    """

    base: BaseProjection = "rectilinear"
    radial: int = 6
    free_degree: int = 0
    bend_degree: int = 0
    stretch_degree: int = 0
    apertures: int = 0
    anamorphic: bool = False

    @cached_property
    def blocks(self) -> dict[str, slice]:
        """Where each named block lies in the vector."""
        stretch = board_degrees(self.stretch_degree)
        sizes = {
            "focal_length": 1,
            "pupil_offset": 1,
            "pupil_gap": 1 if self.anamorphic else 0,
            "pupil_shift": 0 if self.anamorphic else 1,
            "principal_point": 2,
            "radial": self.radial,
            "squeeze": 2,
            "decentering": field.DECENTERING_TERMS,
            "thin_prism": field.PRISM_TERMS,
            "anamorphic": field.ANAMORPHIC_TERMS,
            "free_field": 2 * len(field.free_degrees(self.free_degree)),
            "board_stretch": 2 * len(stretch),
            "aperture_shift": APERTURE_SHIFT_TERMS * self.apertures,
        }
        ends = np.cumsum(list(sizes.values()))
        return {
            name: slice(int(end - size), int(end))
            for (name, size), end in zip(sizes.items(), ends, strict=True)
        }

    @cached_property
    def local_blocks(self) -> dict[str, slice]:
        """Where each block of one photograph lies in its own part of the vector."""
        drift = POSE_PARAMETERS + DRIFT_PARAMETERS
        return {
            "pose": slice(0, POSE_PARAMETERS),
            "row_drift": slice(POSE_PARAMETERS, drift),
            "board_bend": slice(drift, self.local),
        }

    def local_indices(
        self, name: str, views: int
    ) -> Int[np.ndarray, "views parameters"]:
        """Where a local block of every photograph lies in the whole vector."""
        where = self.local_blocks[name]
        starts = self.shared + self.local * np.arange(views)
        return starts[:, None] + np.arange(where.start, where.stop)

    @property
    def shared(self) -> int:
        """Number of parameters that all photographs share."""
        return self.blocks["aperture_shift"].stop

    @property
    def local(self) -> int:
        """Number of parameters of one photograph: pose, row drift, its board's bend."""
        return POSE_PARAMETERS + DRIFT_PARAMETERS + len(board_degrees(self.bend_degree))

    def size(self, views: int) -> int:
        """Length of the whole vector."""
        return self.shared + self.local * views


def board_degrees(degree: int) -> np.ndarray:
    """(i, j) of the Chebyshev products that bend or stretch a board.

    They start at two: constant and linear ones belong to the pose and the pitch.
    """
    pairs = [
        (n - j, j) for n in range(LOWEST_BEND_DEGREE, degree + 1) for j in range(n + 1)
    ]
    return np.array(pairs, int).reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class Prior:
    """Gaussian prior on every parameter; a standard deviation of zero fixes it."""

    mean: Float[np.ndarray, " parameters"]
    standard_deviation: Float[np.ndarray, " parameters"]

    @property
    def free(self) -> np.ndarray:
        """Which parameters may change."""
        return self.standard_deviation > 0


def loose_deviation(layout: Layout, name: str) -> np.ndarray:
    """Loose standard deviations of the parameters of a block that photographs share."""
    where = layout.blocks[name]
    return np.resize(LOOSE[name], where.stop - where.start)


def fixed_prior(parameters: np.ndarray) -> Prior:
    """Everything where it is, nothing free."""
    return Prior(parameters.copy(), np.zeros(len(parameters)))


def release(
    prior: Prior, where: slice | np.ndarray, standard_deviation: float | np.ndarray
) -> Prior:
    """The same prior with some parameters free."""
    deviation = prior.standard_deviation.copy()
    deviation[where] = standard_deviation
    return Prior(prior.mean, deviation)


def with_poses_free(prior: Prior, layout: Layout) -> Prior:
    """The same prior with every pose free, and bends as they were."""
    views = (len(prior.mean) - layout.shared) // layout.local
    return release(prior, layout.local_indices("pose", views), LOOSE["pose"])


def loose_prior(
    parameters: np.ndarray, layout: Layout, tried: np.ndarray, free: np.ndarray
) -> Prior:
    """Loose priors around zero on `free`; zero for what was tried and is not free.

    Every other parameter is held at its present value.
    """
    mean = parameters.copy()
    mean[tried] = 0.0
    views = (len(mean) - layout.shared) // layout.local
    deviation = np.zeros(len(mean))
    for name, where in layout.blocks.items():
        deviation[where] = loose_deviation(layout, name)
    for name in layout.local_blocks:
        deviation[layout.local_indices(name, views)] = LOOSE[name]
    return Prior(mean, np.where(np.isin(np.arange(len(mean)), free), deviation, 0.0))

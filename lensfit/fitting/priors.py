"""Priors of the stages of the geometric fit: which parameters are free, and how wide.

Loose priors keep parameters that the photographs do not determine from diverging, and
have little effect on the others. The principal point stays well inside the frame. Thin
prism resembles decentering with a tilt of the chart and is small: less than 2e-4 in
three designs with elements out of centre by manufacturing tolerances, whose decentering
was up to 1e-3.

A centroid bias proportional to the distance from the axis, as coma causes it, looks
like a chart at another distance; a bias of one or two pixels at the edge is large. The
bias by clipping starts farther out and has a distinct form.
"""

import numpy as np

from lensfit.fitting.parameters import Layout, Prior

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

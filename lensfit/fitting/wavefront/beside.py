"""The dots beside a dot: those that were found, and those that the frame cuts.

A broad dot's neighbours reach into its picture, and where blur is wide into its light.
One that lies across the frame's edge is not found, yet sends light: it is where the dot
on the other side says, as far away as that one.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from lensfit.detect.observations import Observations
from lensfit.fitting.wavefront.dot_patches import Shown

NEIGHBOURS = 8
_CUT_DIAMETERS = 1.0
"""From the frame's edge, within which a dot may have been cut and not found."""


def beside_mm(shown: Shown) -> Float[np.ndarray, "dots neighbours 2"]:
    """From every dot with a cutout to those around it; NaN where there is none."""
    found = beside_px(shown.take.observations, shown.cutouts.marks)
    return found * shown.take.pixel_mm


def beside_px(
    marks: Observations, rows: Int[np.ndarray, " dots"]
) -> Float[np.ndarray, "dots neighbours 2"]:
    """From some of the marks to those around each; NaN where there is none."""
    seen = np.isfinite(marks.diameter_px)
    steps = _steps(marks.lattice[seen])
    here, lattice = marks.points_px[rows][:, None], marks.lattice[rows][:, None]
    beside = _points_at(marks, lattice + steps) - here
    across = here - _points_at(marks, lattice - steps)
    reach_px = _CUT_DIAMETERS * float(np.median(marks.diameter_px[seen]))
    cut = ~_is_within(here + across, marks.image_size_px, reach_px)
    missing = np.isnan(beside).any(-1, keepdims=True)
    return np.where(missing & cut[..., None], across, beside)


def own_cells(
    shown: Shown, beside_mm: Float[np.ndarray, "dots neighbours 2"]
) -> Bool[np.ndarray, "dots rows columns"]:
    """Cells of every cutout nearer to its dot than to any beside it."""
    cutouts, pixel_mm = shown.cutouts, shown.take.pixel_mm
    centre_px = shown.take.observations.points_px[cutouts.marks]
    middle_px = (np.arange(cutouts.light.shape[-1]) + 0.5) * cutouts.cell_px
    x, y = (cutouts.corner_px - centre_px).T[..., None] + middle_px
    beside_px = beside_mm / pixel_mm
    towards = np.einsum("dn,dc->dnc", beside_px[..., 0], x)[:, :, None]
    towards = towards + np.einsum("dn,dr->dnr", beside_px[..., 1], y)[..., None]
    half = np.sum(beside_px**2, -1)[..., None, None] / 2
    # One that is not there, NaN, has no cells.
    return ~np.any(towards > half, 1)


def _steps(lattice: Float[np.ndarray, "dots 2"]) -> Float[np.ndarray, "neighbours 2"]:
    """Around a dot in the middle of the grid, in pitches."""
    middle = int(np.argmin(np.sum((lattice - lattice.mean(0)) ** 2, -1)))
    away = lattice - lattice[middle]
    nearest = np.argsort(np.sum(away**2, -1), kind="stable")
    # The dot itself comes first.
    return away[nearest[1 : NEIGHBOURS + 1]]


def _points_at(
    marks: Observations, lattice: Float[np.ndarray, "*shape 2"]
) -> Float[np.ndarray, "*shape 2"]:
    """Where marks of these coordinates were found; NaN where none was."""
    away, nearest = KDTree(marks.lattice).query(lattice)
    found = np.asarray(away) < 0.1
    return np.where(found[..., None], marks.points_px[np.asarray(nearest)], np.nan)


def _is_within(
    points_px: Float[np.ndarray, "*shape 2"], size_px: tuple[int, int], reach_px: float
) -> Bool[np.ndarray, "*shape"]:
    """Whether points lie in the frame, by so much; not those that are NaN."""
    inside = (points_px >= reach_px) & (points_px <= np.array(size_px) - reach_px)
    return np.asarray(inside.all(-1) | np.isnan(points_px).any(-1))

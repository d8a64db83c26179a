"""Neighbours of a dot: those that were detected, and those that the frame cuts.

A broad dot's neighbours reach into its patch, and where blur is wide into its light. A
dot that lies across the frame's edge is not detected, yet sends light. It is assumed to
lie opposite the detected neighbour on the other side, at the same distance.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from lensfit.detect.observations import Observations
from lensfit.fitting.wavefront.dot_arrays import NEIGHBOURS
from lensfit.fitting.wavefront.dot_patches import DotPhotograph

_CUT_DIAMETERS = 1.0
"""Distance from the frame's edge within which a dot may be cut and not detected."""


def neighbour_offsets_mm(
    photograph: DotPhotograph,
) -> Float[np.ndarray, "dots neighbours 2"]:
    """From every dot with a patch to those around it; NaN where there is none."""
    found = neighbour_offsets_px(
        photograph.take.observations, photograph.dot_images.marks
    )
    return found * photograph.take.pixel_mm


def neighbour_offsets_px(
    detections: Observations, rows: Int[np.ndarray, " dots"]
) -> Float[np.ndarray, "dots neighbours 2"]:
    """From some of the detected dots to those around each; NaN where there is none."""
    seen = np.isfinite(detections.diameter_px)
    steps = _steps(detections.lattice[seen])
    here, lattice = (
        detections.points_px[rows][:, None],
        detections.lattice[rows][:, None],
    )
    beside = _points_at(detections, lattice + steps) - here
    across = here - _points_at(detections, lattice - steps)
    reach_px = _CUT_DIAMETERS * float(np.median(detections.diameter_px[seen]))
    cut = ~_is_within(here + across, detections.image_size_px, reach_px)
    missing = np.isnan(beside).any(-1, keepdims=True)
    return np.where(missing & cut[..., None], across, beside)


def own_cells(
    photograph: DotPhotograph,
    neighbour_offsets_mm: Float[np.ndarray, "dots neighbours 2"],
) -> Bool[np.ndarray, "dots rows columns"]:
    """Cells of every patch nearer to its own dot than to any neighbour."""
    dot_images, pixel_mm = photograph.dot_images, photograph.take.pixel_mm
    centre_px = photograph.take.observations.points_px[dot_images.marks]
    middle_px = (np.arange(dot_images.light.shape[-1]) + 0.5) * dot_images.cell_px
    x, y = (dot_images.corner_px - centre_px).T[..., None] + middle_px
    neighbour_offsets_px = neighbour_offsets_mm / pixel_mm
    towards = np.einsum("dn,dc->dnc", neighbour_offsets_px[..., 0], x)[:, :, None]
    towards = (
        towards + np.einsum("dn,dr->dnr", neighbour_offsets_px[..., 1], y)[..., None]
    )
    half = np.sum(neighbour_offsets_px**2, -1)[..., None, None] / 2
    # A neighbour that does not exist, NaN, has no cells.
    return ~np.any(towards > half, 1)


def _steps(lattice: Float[np.ndarray, "dots 2"]) -> Float[np.ndarray, "neighbours 2"]:
    """Around a dot in the middle of the grid, in pitches."""
    middle = int(np.argmin(np.sum((lattice - lattice.mean(0)) ** 2, -1)))
    away = lattice - lattice[middle]
    nearest = np.argsort(np.sum(away**2, -1), kind="stable")
    # The dot itself comes first.
    return away[nearest[1 : NEIGHBOURS + 1]]


def _points_at(
    detections: Observations, lattice: Float[np.ndarray, "*shape 2"]
) -> Float[np.ndarray, "*shape 2"]:
    """Detected points at these lattice coordinates; NaN where there is none."""
    away, nearest = KDTree(detections.lattice).query(lattice)
    found = np.asarray(away) < 0.1
    return np.where(found[..., None], detections.points_px[np.asarray(nearest)], np.nan)


def _is_within(
    points_px: Float[np.ndarray, "*shape 2"], size_px: tuple[int, int], reach_px: float
) -> Bool[np.ndarray, "*shape"]:
    """Whether points lie in the frame by this distance; true where they are NaN."""
    inside = (points_px >= reach_px) & (points_px <= np.array(size_px) - reach_px)
    return np.asarray(inside.all(-1) | np.isnan(points_px).any(-1))

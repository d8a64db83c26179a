"""Dots beside a dot: found ones, and those that the frame cuts."""

from types import SimpleNamespace

import numpy as np
import pytest

from lensfit.fitting.wavefront.dot_patches import neighbour_offsets_px, own_cells

PITCH_PX, SIZE_PX = 30.0, (200, 160)


def marks(*, found_from_px: float, staggered: bool = False):
    """Of a chart that goes on beyond the left edge and ends before the right one."""
    j, i = np.mgrid[:5, -1:5].astype(float).reshape(2, -1)
    lattice = np.stack([2 * i + j % 2, j] if staggered else [i, j], -1)
    pitch = np.array([PITCH_PX / 2 if staggered else PITCH_PX, PITCH_PX])
    points = lattice * pitch + [20.0, 20.0]
    found = points[:, 0] > found_from_px
    return SimpleNamespace(
        lattice=lattice[found],
        points_px=points[found],
        diameter_px=np.full(found.sum(), 20.0),
        image_size_px=SIZE_PX,
    )


def beside(seen, at_px):
    row = np.flatnonzero((seen.points_px == at_px).all(-1))
    found = neighbour_offsets_px(seen, row)[0]
    return found[np.isfinite(found).all(-1)]


def test_a_dot_in_the_middle_has_all_around_it():
    seen = marks(found_from_px=10)
    found = beside(seen, (80.0, 80.0))
    assert sorted(np.hypot(*found.T) / PITCH_PX) == pytest.approx(
        [1.0] * 4 + [2**0.5] * 4
    )


def test_what_the_frame_cuts_is_beside_though_not_found():
    found = beside(marks(found_from_px=10), (20.0, 80.0))
    assert (found == (-PITCH_PX, 0.0)).all(-1).any()


def test_beyond_the_end_of_the_chart_there_is_nobody():
    seen = marks(found_from_px=10)
    found = beside(seen, (140.0, 80.0))
    assert found[:, 0].max() == 0


def test_a_staggered_grid_has_its_own_neighbours():
    seen = marks(found_from_px=10, staggered=True)
    (inside,) = np.flatnonzero((seen.lattice == [4, 2]).all(-1))
    found = beside(seen, seen.points_px[inside])
    assert np.hypot(*found.T).min() == pytest.approx(PITCH_PX)
    assert (np.abs(found) == [PITCH_PX / 2, PITCH_PX]).all(-1).sum() == 4


def test_cells_nearer_to_another_dot_are_not_its_own():
    dot_images = SimpleNamespace(
        marks=np.array([0]),
        corner_px=np.array([[38.0, 38.0]]),
        light=np.zeros((1, 3, 24, 24)),
        cell_px=1,
    )
    seen = SimpleNamespace(points_px=np.array([[50.0, 50.0]]))
    take = SimpleNamespace(observations=seen, pixel_mm=np.array([0.01, 0.01]))
    neighbour_offsets_mm = np.array([[[0.1, 0.0], [np.nan, np.nan]]])
    own = own_cells(
        SimpleNamespace(dot_images=dot_images, take=take), neighbour_offsets_mm
    )[0]
    assert own[:, :17].all()
    assert not own[:, 17:].any()

"""Lattice indices of simulated points: every hard view, nothing mis-indexed."""

import numpy as np
import pytest
from dots_scene import grid, same_lattice, view

from lensfit.detect.lattice import index_lattice

CENTRE = np.array([1000.0, 800.0])


def spoiled(points, seed, *, missing=0.2, dirt=0.05, jitter_px=0.1):
    """Drop some points, add random ones; truth index of each, -1 for dirt."""
    rng = np.random.default_rng(seed)
    kept = np.flatnonzero(rng.random(len(points)) > missing)
    low, high = points.min(0), points.max(0)
    extra = low + rng.random((round(dirt * len(points)), 2)) * (high - low)
    measured = points[kept] + rng.normal(size=(len(kept), 2)) * jitter_px
    truth = np.concatenate([kept, np.full(len(extra), -1)])
    order = rng.permutation(len(truth))
    return np.concatenate([measured, extra])[order], truth[order]


def check(lattice, points, truth, *, least=0.99, stray=0.35, **kwargs):
    indices, valid = index_lattice(points, **kwargs)
    real = valid & (truth >= 0)
    assert np.count_nonzero(real) >= least * np.count_nonzero(truth >= 0)
    assert same_lattice(indices[real], lattice[truth[real]], turned=True)
    # Dirt can only be taken where it happens to lie on a missing point's cell.
    assert np.count_nonzero(valid & (truth < 0)) <= stray * np.count_nonzero(truth < 0)
    assert (indices[valid].min(0) == 0).all()


@pytest.mark.parametrize("angle_deg", range(0, 360, 25))
def test_any_rotation_with_missing_points_and_dirt(angle_deg):
    lattice = grid(30, 20)
    points = view(lattice, CENTRE, 40.0, angle_deg=angle_deg)
    check(lattice, *spoiled(points, angle_deg))


@pytest.mark.parametrize("angle_deg", [0, 12, 45, 80])
def test_thirty_degrees_of_perspective(angle_deg):
    lattice = grid(30, 24)
    points = view(lattice, CENTRE, 40.0, angle_deg=angle_deg, tilt_deg=30)
    check(lattice, *spoiled(points, 1))


@pytest.mark.parametrize("seed", range(4))
def test_fish_eye_barrel_with_missing_points_and_dirt(seed):
    lattice = grid(49, 36)
    points = view(lattice, CENTRE, 45.0, angle_deg=3, tilt_deg=10, barrel=0.35)
    check(lattice, *spoiled(points, seed), least=0.98)


def test_upright_means_i_right_and_j_down():
    lattice = grid(12, 9)
    for angle_deg in (-40, -10, 0, 10, 40):
        points = view(lattice, CENTRE, 30.0, angle_deg=angle_deg)
        indices, valid = index_lattice(points)
        assert valid.all()
        assert np.array_equal(indices, lattice)


def test_a_hole_and_an_island_across_a_gap_keep_their_register():
    lattice = grid(40, 30)
    points = view(lattice, CENTRE, 30.0, angle_deg=7, barrel=0.2)
    i, j = lattice.T
    hole = (abs(i - 20) < 5) & (abs(j - 15) < 4)
    gap = (i >= 30) & (i < 33)  # three whole columns missing
    seen = ~(hole | gap)
    truth = np.flatnonzero(seen)
    check(lattice, points[seen], truth)


def test_cropped_by_a_slanted_frame():
    lattice = grid(60, 50)
    points = view(lattice, CENTRE, 40.0, angle_deg=33, tilt_deg=20)
    inside = (np.abs(points - CENTRE) < [600, 400]).all(1)
    check(lattice, points[inside], np.flatnonzero(inside), least=1.0)


def test_unequal_pitches():
    lattice = grid(25, 25)
    points = view(lattice * [1.0, 2.0], CENTRE, 30.0, angle_deg=20)
    check(lattice, *spoiled(points, 3))


def test_asymmetric_circle_grid_counts_half_steps():
    row, column = np.mgrid[:11, :8]
    lattice = np.stack([(2 * column + row % 2).ravel(), row.ravel()], 1)
    points = view(lattice, CENTRE, 25.0, angle_deg=15, tilt_deg=25)
    indices, valid = index_lattice(points, asymmetric=True)
    assert valid.all()
    assert (indices.sum(1) % 2 == 0).all()
    assert same_lattice(indices, lattice)


def test_random_points_and_a_handful_have_no_lattice():
    rng = np.random.default_rng(5)
    valid = index_lattice(rng.random((800, 2)) * 1000)[1]
    assert np.count_nonzero(valid) < 30
    assert not index_lattice(rng.random((5, 2)) * 100)[1].any()
    assert not index_lattice(np.zeros((0, 2)))[1].any()


def test_points_on_one_line_are_not_a_lattice():
    points = np.stack([np.arange(50) * 20.0, np.full(50, 7.0)], 1)
    assert not index_lattice(points)[1].any()


def test_twenty_thousand_points():
    lattice = grid(179, 121)
    points, truth = spoiled(view(lattice, CENTRE, 22.0, barrel=0.1), 8, missing=0.05)
    check(lattice, points, truth)

"""An object's distance over everything it touches, and nowhere else."""

import numpy as np
import pytest

from lensfit.plate.own_pixels import NOBODY, own_pixels

FAR, NEAR = np.float32(9000), np.float32(1000)


def test_a_soft_edge_gets_the_distance_of_its_object():
    coverage = np.tile(np.float32([0, 0, 0.3, 0.8, 1, 1, 1]), (5, 1))
    depth = np.where(coverage > 0.9, NEAR, FAR).astype(np.float32)
    extended, lender = own_pixels(depth, coverage)
    assert (extended[:, 2:] == NEAR).all()
    assert (extended[:, :2] == FAR).all()
    assert extended.dtype == np.float32
    assert lender[0].tolist() == [NOBODY, NOBODY, 4, 4, 4, 5, 6]


def test_a_slanted_object_lends_its_nearest_own_distance():
    coverage = np.tile(np.float32([0.5, 1, 1, 1, 0.5]), (3, 1))
    depth = np.tile(np.float32([9000, 1000, 1100, 1200, 9000]), (3, 1))
    extended, lender = own_pixels(depth, coverage)
    assert extended[1].tolist() == [1000, 1000, 1100, 1200, 1200]
    assert lender[1].tolist() == [6, 6, 7, 8, 8]


def test_a_wire_thinner_than_a_pixel_keeps_the_least_distance_along_it():
    coverage = np.zeros((7, 9), np.float32)
    coverage[3], coverage[4] = 0.4, 0.2
    depth = np.full(coverage.shape, FAR)
    depth[3, ::2] = NEAR  # every other pixel was hit
    extended, lender = own_pixels(depth, coverage)
    assert (extended[3:5] == NEAR).all()
    assert (extended[[2, 5]] == FAR).all()
    assert (lender == NOBODY).all()


def test_an_object_that_is_not_there_changes_nothing():
    depth = np.random.default_rng(0).random((4, 5), np.float32) + 1
    for coverage in (np.zeros_like(depth), np.ones_like(depth)):
        assert own_pixels(depth, coverage)[0] == pytest.approx(depth)

"""Cut out: a wire over a wall comes apart into the wire and the wall it hides."""

import numpy as np
import pytest

from lensfit.io.cryptomatte import Ranks
from lensfit.plate.cut_out import NOBODY, cut_out, own_pixels
from lensfit.rendering.layer_stack import LayerStack, flattened_layers

NEAR, FAR = np.float32(1000), np.float32(9000)
WALL, WIRE = 7, 8
SIZE = 24, 40


def wire_coverage():
    """A slanted wire three pixels wide, whose edges are soft."""
    y, x = np.indices(SIZE) + 0.5
    return np.clip(2 - np.abs(x - 20 - y / 5), 0, 1).astype(np.float32)


def ranks(coverage):
    """Two ranks, the larger share first."""
    most = np.maximum(coverage, 1 - coverage)
    wire_first = coverage >= 0.5
    ids = np.stack([np.where(wire_first, WIRE, WALL), np.where(wire_first, WALL, WIRE)])
    ids[1][most == 1] = 0
    return Ranks(ids.astype(np.uint32), np.stack([most, 1 - most]))


def wall():
    y, x = np.indices(SIZE) / 12
    planes = [1 + np.sin(x), 1 + np.cos(y), 1 + np.sin(x + y), np.full(SIZE, 2)]
    return (np.stack(planes, -1) / 2).astype(np.float32)


def plate(coverage):
    wire = np.float32([0.7, 0.5, 0.2, 1])
    c = coverage[..., None]
    return c * wire + (1 - c) * wall()


DEPTHS = {
    "nearest": lambda c: np.where(c > 0, NEAR, FAR),
    "farthest": lambda c: np.where(c < 1, FAR, NEAR),
    "centre": lambda c: np.where(c > 0.5, NEAR, FAR),
    "mean": lambda c: c * NEAR + (1 - c) * FAR,
}


@pytest.mark.parametrize("kind", DEPTHS)
def test_it_does_not_matter_whose_distance_a_shared_pixel_has(kind):
    coverage = wire_coverage()
    depth = DEPTHS[kind](coverage).astype(np.float32)
    found = cut_out(depth, ranks(coverage), [WIRE])
    assert (found.depth_mm[coverage > 0.01] == NEAR).all()
    assert (found.rest_depth_mm == FAR).all()
    assert (found.rest_mattes.ids[0] == WALL).all()
    assert found.rest_mattes.coverage[0] == pytest.approx(1)
    assert found.coverage == pytest.approx(coverage)


@pytest.mark.parametrize("count", [1, 3, 4])
def test_the_layer_over_what_it_hides_is_the_plate(count):
    coverage = wire_coverage()
    pixels = plate(coverage)[..., :count]
    found = cut_out(DEPTHS["centre"](coverage), ranks(coverage), [WIRE])
    rest, layer = found.cut(pixels)
    full = np.ones((*SIZE, 4), np.float32)
    full[..., : max(count, 3)] = rest
    back = LayerStack(np.stack([layer.rgba[0], full]), np.ones((2, *SIZE), np.float32))
    assert flattened_layers(back)[..., :count] == pytest.approx(pixels, abs=1e-6)
    assert layer.rgba[0, ..., 3] == pytest.approx(coverage, abs=1e-6)
    assert rest == pytest.approx(wall()[..., :count], abs=0.15)
    free = coverage == 0
    assert (rest[free] == pixels[free]).all()
    assert not layer.rgba[0, free].any()


def test_a_light_beside_a_wire_stays_where_it_is():
    coverage = wire_coverage()
    pixels, both = plate(coverage), ranks(coverage)
    at = tuple(np.argwhere((coverage > 0.2) & (coverage < 0.5))[6])
    pixels[at][:3] = 100
    rest, layer = cut_out(DEPTHS["centre"](coverage), both, [WIRE]).cut(pixels)
    assert layer.rgba.max() < 3
    share = float(coverage[at])
    shown = layer.rgba[(0, *at)][:3] + (1 - share) * rest[at][:3]
    assert shown == pytest.approx(100, rel=1e-5)
    others = np.delete(rest.reshape(-1, 4), np.ravel_multi_index(at, SIZE), 0)
    assert others.max() < 2  # nor does it go on behind the wire


def test_what_stands_in_front_of_an_object_is_left_in_the_plate():
    coverage = wire_coverage()
    depth = np.where(coverage > 0.5, FAR, NEAR).astype(np.float32)
    found = cut_out(depth, ranks(coverage), [WIRE])
    assert not found.coverage.any()
    assert (found.rest_depth_mm == depth).all()
    rest, layer = found.cut(plate(coverage))
    assert (rest == plate(coverage)).all()
    assert not layer.rgba.any()


def test_an_object_that_fills_the_plate_or_none_of_it_is_left():
    depth = np.full(SIZE, NEAR)
    for coverage in (np.zeros(SIZE, np.float32), np.ones(SIZE, np.float32)):
        found = cut_out(depth, ranks(coverage), [WIRE])
        rest, _ = found.cut(plate(coverage))
        assert (rest == plate(coverage)).all()
        assert (found.seen_depth_mm == NEAR).all()


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

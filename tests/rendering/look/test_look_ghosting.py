"""Ghosts: mirrored through the optical centre, in the shape of the opening."""

import numpy as np
import pytest
from look_makers import (
    FRAME,
    HEIGHT,
    WIDTH,
    centroid,
    depth_plane,
    grey,
    ideal_lens,
    looked,
    with_light,
)

from lensfit.rendering.look.ghosting import ApertureShape, diameter_of, shrunk, tint_of
from lensfit.rendering.uv import PlateGeometry

LUMINANCE = (0.2126, 0.7152, 0.0722)
ROW, COLUMN = 50, 160


def ghosts_of(picture, count=1, **knobs):
    """The ghosts alone, green."""
    made = looked(picture, ghost_gain=0.5, ghost_count=count, **knobs)
    return (made - picture)[..., 1]


def test_a_ghost_stands_opposite_and_holds_its_share():
    found = ghosts_of(with_light(ROW, COLUMN, 104.0))
    assert found.sum() == pytest.approx(0.5 * 100, rel=1e-4)
    opposite = [WIDTH - COLUMN - 0.5, HEIGHT - ROW - 0.5]
    assert centroid(found) == pytest.approx(opposite, abs=0.02)


@pytest.mark.parametrize("reach", [-0.5, 0.25, 1.5])
def test_the_reach_says_where(reach):
    found = ghosts_of(with_light(70, 140, 104.0), ghost_reach=reach)
    centre = np.array([WIDTH, HEIGHT]) / 2
    light = np.array([140.5, 70.5])
    assert centroid(found) == pytest.approx(centre - reach * (light - centre), abs=0.02)


def test_ghosts_of_one_light_share_its_light_and_line_up():
    picture = with_light(ROW, COLUMN, 104.0)
    found = ghosts_of(picture, count=4, ghost_size_percent=3.0)
    assert found.sum() == pytest.approx(50, rel=1e-4)
    centre = np.array([WIDTH, HEIGHT]) / 2
    away = centre - np.array([COLUMN + 0.5, ROW + 0.5])
    assert centroid(found) == pytest.approx(centre + away * 2.5 / 4, abs=0.05)
    for n in (1, 2, 3, 4):
        x, y = np.floor(centre + away * n / 4).astype(int)
        assert found[y, x] > 0.01


def test_the_ghost_of_an_ideal_lens_is_a_disc_of_the_size():
    found = ghosts_of(with_light(ROW, COLUMN, 1004.0), ghost_size_percent=20.0)
    y, x = np.indices(found.shape) + 0.5
    middle = centroid(found)
    r = np.hypot(x - middle[0], y - middle[1])
    radius = 0.1 * WIDTH
    level = 500 / (np.pi * radius**2)
    assert found[r < radius - 4] == pytest.approx(level, rel=0.05)
    assert found[r > radius + 6].max() < 1e-9


def test_a_ghost_does_not_know_the_focus():
    picture = with_light(ROW, COLUMN, 1000.0)
    sharp = ghosts_of(picture)
    depth = depth_plane(600.0)
    blurred = looked(picture, depth, ghost_gain=0.5, ghost_count=1) - looked(
        picture, depth
    )
    assert blurred[..., 1] == pytest.approx(sharp, abs=1e-4)


def test_a_ghost_beside_the_frame_is_gone_and_dim_light_has_none():
    assert ghosts_of(with_light(2, 2, 1000.0), ghost_reach=2.0).max() == 0
    dim = grey(1.9)
    assert looked(dim, ghost_gain=1.0).tobytes() == dim.tobytes()


def test_exposure_and_threshold_scale_together():
    picture = with_light(ROW, COLUMN, 50.0, 0.3)
    one = looked(picture, ghost_gain=0.3, ghost_threshold=2.0)
    four = looked(4 * picture, ghost_gain=0.3, ghost_threshold=8.0)
    assert four == pytest.approx(4 * one, rel=1e-4)


@pytest.mark.parametrize("tint", [-1.0, -0.3, 0.0, 0.6, 1.0])
def test_the_tint_keeps_the_luminance(tint):
    gains = tint_of(tint, LUMINANCE)
    assert gains @ LUMINANCE == pytest.approx(1, rel=1e-6)
    assert gains.min() >= 0
    assert np.sign(gains[1] - gains[0]) == np.sign(tint)


def test_a_disc_has_its_own_diameter_at_any_size():
    opening = ApertureShape.of(
        ideal_lens(), PlateGeometry.of(ideal_lens(), FRAME), FRAME
    )
    assert opening.diameter_px == pytest.approx(96, rel=0.01)
    for factor in (0.1, 0.37, 1.0, 1.6):
        small = shrunk(opening.shapes[0], factor)
        assert small.shape[0] % 2 == 1
        assert small.sum() == pytest.approx(1, rel=1e-5)
        # A pixel's own width adds to the mean square.
        exact = np.sqrt((96 * factor) ** 2 + 2 / 3 * 2)
        assert diameter_of(small) == pytest.approx(exact, rel=0.02)


def test_lights_are_dealt_to_the_nodes_around_them():
    shapes = np.zeros((9, 3, 3), np.float32)
    opening = ApertureShape(shapes, (200, 100), 1.0)
    points = np.array([[0.0, 0.0], [100.0, 50.0], [150.0, 25.0], [230.0, 120.0]])
    weights = np.stack([weights for weights, _ in opening.node_shares(points)])
    assert weights.sum(0) == pytest.approx(1)
    assert weights[0, 0] == weights[4, 1] == weights[8, 3] == 1
    assert weights[[1, 2, 4, 5], 2] == pytest.approx(0.25)

"""Which surface a ray meets first, and what it lets through."""

import dataclasses

import numpy as np
import pytest

from data_synth.scene.crossings import crossings, radiance_along, share_let_through
from data_synth.scene.layers import (
    Layer,
    Scene,
    SceneRays,
    floor_plane,
    square_plane,
    wall_plane,
)
from data_synth.scene.paints import Plain
from data_synth.scene.shapes import Everywhere, Rectangle

WHITE = Plain((1.0, 1.0, 1.0))
GREY = Plain((0.2, 0.2, 0.2))


def rays_from(seed: int = 0, count: int = 400) -> SceneRays:
    rng = np.random.default_rng(seed)
    return SceneRays(rng.uniform(-9, 9, (count, 2)), rng.uniform(-0.3, 0.3, (count, 2)))


def test_every_plane_meets_rays_on_itself():
    """A point of the ray at the stated depth, and the plane's own, are the same."""
    rays = rays_from()
    for plane in (
        square_plane(900.0),
        floor_plane(300.0, 1000.0),
        wall_plane((-200.0, 0.0, 700.0), 1.1),
    ):
        depth = plane.depth_mm(rays)
        met = np.flatnonzero(np.isfinite(depth))
        assert len(met) > 50
        ahead, depth = rays.some(met), depth[met]
        place = plane.place_mm(ahead, depth)
        across = ahead.pupil_mm + ahead.slope * depth[:, None]
        scene = np.column_stack([across, depth])
        np.testing.assert_allclose(plane.scene_mm(place), scene, atol=1e-6)


def test_the_floor_is_met_where_a_falling_ray_reaches_it():
    down = SceneRays(np.zeros((3, 2)), np.array([[0.0, 0.2], [0.0, 0.0], [0.0, -0.2]]))
    depth = floor_plane(300.0, 1000.0).depth_mm(down)
    np.testing.assert_allclose(depth, [1500.0, np.inf, np.inf])


def test_nearer_covers_farther_and_a_veil_shares():
    layers = (
        Layer("far", square_plane(900.0), Everywhere(), WHITE),
        Layer("veil", square_plane(500.0), Everywhere(), GREY, opacity=0.3),
        Layer("edge", square_plane(400.0), Rectangle((0.0, -1e4), (1e4, 1e4)), GREY),
    )
    rays = rays_from()
    x = rays.pupil_mm[:, 0] + 400 * rays.slope[:, 0]
    expected = np.where(x >= 0, 0.2, 0.3 * 0.2 + 0.7 * 1.0)
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        scene = Scene(tuple(layers[k] for k in order))
        np.testing.assert_allclose(radiance_along(scene, rays, 1), expected)


def test_a_wall_through_a_plane_is_before_it_on_one_side_only():
    """They intersect at x = 100: the nearer one wins on each side."""
    plane = Layer("plane", square_plane(1000.0), Everywhere(), WHITE)
    wall = Layer("wall", wall_plane((100.0, 0.0, 1000.0), 0.5), Everywhere(), GREY)
    rays = rays_from()
    x = rays.pupil_mm[:, 0] + 1000 * rays.slope[:, 0]
    expected = np.where(x < 100, 0.2, 1.0)
    for layers in ((plane, wall), (wall, plane)):
        np.testing.assert_allclose(radiance_along(Scene(layers), rays, 0), expected)


def test_two_tilted_layers_between_the_same_planes_cover_by_depth():
    walls = [
        Layer("near", wall_plane((0.0, 0.0, 600.0), 0.3), Everywhere(), GREY),
        Layer("far", wall_plane((0.0, 0.0, 800.0), -0.2), Everywhere(), WHITE),
    ]
    back = Layer("back", square_plane(5000.0), Everywhere(), WHITE)
    rays = rays_from()
    depth = np.stack([wall.plane.depth_mm(rays) for wall in walls])
    expected = np.where(depth[0] < depth[1], 0.2, 1.0)
    for order in ([0, 1], [1, 0]):
        layers = (back, *(walls[k] for k in order))
        np.testing.assert_allclose(radiance_along(Scene(layers), rays, 2), expected)


@pytest.mark.parametrize("opacity", [0.4, 1.0])
def test_what_is_let_through_is_what_no_nearer_layer_keeps(opacity):
    half = Rectangle((-1e4, -1e4), (20.0, 1e4))
    layers = (
        Layer("a", square_plane(300.0), half, GREY, opacity=opacity),
        Layer("b", wall_plane((0.0, 0.0, 500.0), 0.4), half, GREY, opacity=0.5),
    )
    rays = rays_from()
    through = share_let_through(layers, rays, np.full(len(rays), 1500.0))
    kept = np.zeros(len(rays))
    for met in crossings(layers, rays):
        nearer = met.depth_mm < 1500.0
        kept[met.rays[nearer]] += met.share[nearer]
    np.testing.assert_allclose(through, 1 - kept)
    assert 0.0 < through.mean() < 1.0
    behind = tuple(
        dataclasses.replace(layer, plane=square_plane(2000.0)) for layer in layers
    )
    np.testing.assert_array_equal(
        share_let_through(behind, rays, np.full(len(rays), 1500.0)), 1.0
    )

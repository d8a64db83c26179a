"""Rays of a lens over a plate: the disc of an ideal lens, straight lines in the scene,
and what interpolation between nodes costs."""

from pathlib import Path

import numpy as np
import pytest
from ideal_lens import HEIGHT, WIDTH, ideal_lens

import lensfit
from lensfit.coords import Window
from lensfit.rendering.circle import Circle
from lensfit.rendering.ray_field import (
    COLUMNS,
    ROWS,
    DepthNodes,
    disc_field,
    disc_spiral,
    lens_field,
)
from lensfit.rendering.uv import PlateGeometry

PRIME = Path(__file__).parents[2] / "presets" / "prime_50" / "preset.json"
FRAME = Window.of_size(960, 540)
DEPTH = DepthNodes.over(-8.0, 12.0)


def prime():
    lens = lensfit.load_preset(PRIME)
    return lens.at(focal_length_mm=50.0, f_number=2.0, focus_distance_mm=2000.0)


def field_of(lens, window=FRAME, depth=DEPTH, rays=48, nodes=(COLUMNS, ROWS)):
    geometry = PlateGeometry.of(lens, window)
    circle = Circle.of(lens, geometry)
    return lens_field(lens, geometry, circle, window, depth, (rays,), nodes)[0]


@pytest.mark.parametrize("rays", [18, 48, 384])
def test_places_have_the_moments_of_the_disc(rays: int):
    azimuth, reach = disc_spiral(rays)
    x, y = reach * np.cos(azimuth), reach * np.sin(azimuth)
    assert np.abs([x.mean(), y.mean(), (x * y).mean()]).max() < 1e-3
    assert [(x * x).mean(), (y * y).mean()] == pytest.approx([0.25, 0.25], rel=5e-3)
    assert reach.max() <= 1


def test_an_ideal_lens_has_the_rays_of_its_disc():
    window = Window.of_size(WIDTH, HEIGHT)
    rays = field_of(ideal_lens(), window, DepthNodes.over(-8.0, 8.0))
    disc = disc_field(window, 48)
    for radius in (-8.0, -3.0, 5.0):
        found, exact = (f.displacements_px(radius)[-1] for f in (rays, disc))
        assert np.abs(found - exact).max() < 0.03 * abs(radius)


def test_every_pixel_gets_all_of_its_light():
    rays = field_of(prime())
    assert np.abs(rays.weight.sum(-1) - 1).max() < 1e-5
    assert rays.weight.min() > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frame", "depth", "nodes"),
    [
        (FRAME, DEPTH, (COLUMNS, ROWS)),
        # The same blur on a quarter of the pixels.
        (Window.of_size(240, 135), DepthNodes.over(-2.0, 3.0), (11, 7)),
    ],
)
def test_between_nodes_rays_are_known_to_a_tenth_of_a_pixel(frame, depth, nodes):
    coarse = field_of(prime(), frame, depth, nodes=nodes)
    twice = tuple(2 * n - 1 for n in nodes)
    fine = field_of(prime(), frame, depth, nodes=twice)
    for radius in (depth.far, 0.0, depth.near):
        at = coarse.displacements_px(radius)
        middle = (at[:, 1:] + at[:, :-1]) / 2
        middle = (middle[:, :, 1:] + middle[:, :, :-1]) / 2
        exact = fine.displacements_px(radius)[:, 1::2, 1::2]
        away = np.abs(middle - exact)
        assert np.quantile(away, 0.95) < 0.1
        assert away.max() < 0.5


def test_between_depths_rays_are_known_to_a_tenth_of_a_pixel():
    whole = field_of(prime())
    part = field_of(prime(), depth=DepthNodes.over(-4.0, 6.0))
    for radius in (-4.0, -2.0, 3.0, 6.0):
        away = whole.displacements_px(radius) - part.displacements_px(radius)
        assert np.abs(away).max() < 0.1


def test_a_ray_is_a_straight_line_in_the_scene():
    """Its places are linear in vergence, but for a little that aberrations change."""
    rays = field_of(prime())
    assert np.abs(rays.moved_px[..., 2] * 12.0**2).max() < 0.05 * 12.0

"""Outlines and paints of scenes: areas in closed form, holes, grids of many pieces."""

import numpy as np
import pytest

from data_synth.irradiance import shifted_sobol
from data_synth.scene.paints import Checker, Plain, Product, Star, Waves, Windows
from data_synth.scene.shapes import (
    Discs,
    Everywhere,
    Leaves,
    Rectangle,
    Strips,
    Union,
    Without,
)

HALF_MM = 3.0
PLACES = (shifted_sobol(2, 1 << 16, 1, seed=3)[0] * 2 - 1) * HALF_MM
"""Evenly over a square of 6 mm."""


def area_mm2(shape) -> float:
    return float(shape.contains(PLACES).mean()) * (2 * HALF_MM) ** 2


def leaf_area_mm2(length: float, width: float) -> float:
    """Two circular segments of half-chord `length` and height `width`."""
    radius = (length**2 + width**2) / (2 * width)
    angle = 2 * np.arcsin(length / radius)
    return float(radius**2 * (angle - np.sin(angle)))


def one_leaf(azimuth_rad: float) -> Leaves:
    return Leaves(
        np.array([[0.3, -0.2]]),
        np.array([1.5]),
        np.array([0.6]),
        np.array([azimuth_rad]),
    )


@pytest.mark.parametrize("azimuth_rad", [0.0, 0.7, 2.5])
def test_a_leaf_has_the_area_of_two_segments_and_ends_at_its_tips(azimuth_rad):
    leaf = one_leaf(azimuth_rad)
    assert area_mm2(leaf) == pytest.approx(leaf_area_mm2(1.5, 0.6), rel=2e-3)
    along = np.array([np.cos(azimuth_rad), np.sin(azimuth_rad)])
    across = np.array([-along[1], along[0]])
    centre = np.array([0.3, -0.2])
    inside = [centre + 1.499 * along, centre - 0.599 * across]
    outside = [centre + 1.501 * along, centre + 0.601 * across]
    assert leaf.contains(np.array(inside)).all()
    assert not leaf.contains(np.array(outside)).any()


def test_a_strip_has_the_area_of_length_times_width():
    strip = Strips(np.array([[-1.0, -1.5]]), np.array([[2.0, 1.0]]), np.array([0.2]))
    assert area_mm2(strip) == pytest.approx(np.hypot(3.0, 2.5) * 0.2, rel=5e-3)


def test_holes_take_from_a_sheet_what_they_cover():
    holes = Discs(np.array([[0.0, 0.0], [1.2, 0.0]]), np.array([0.5, 0.3]))
    sheet = Rectangle((-2.0, -1.0), (2.0, 1.0))
    ring = Without(sheet, holes)
    assert area_mm2(ring) == pytest.approx(8.0 - np.pi * 0.34, rel=2e-3)
    both = Union((ring, holes))
    np.testing.assert_array_equal(both.contains(PLACES), sheet.contains(PLACES))
    assert Everywhere().contains(PLACES).all()
    assert not Union().contains(PLACES).any()


def test_the_grid_over_many_pieces_finds_what_trying_all_of_them_finds():
    rng = np.random.default_rng(5)
    centre = rng.normal(0, 1.2, (70, 2))
    radius = rng.uniform(0.02, 0.4, 70)
    away = np.hypot(*np.moveaxis(PLACES[:5000, None] - centre, -1, 0))
    np.testing.assert_array_equal(
        Discs(centre, radius).contains(PLACES[:5000]), (away <= radius).any(axis=1)
    )


def test_paints_have_the_mean_that_their_parts_state():
    checker = Checker((1.0, 0.5, 0.0), (0.0, 0.5, 1.0), (0.5, np.inf))
    np.testing.assert_allclose(checker.radiance(PLACES).mean(axis=0), 0.5, atol=2e-3)
    star = Star((0.0, 0.0), 7, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(star.radiance(PLACES).mean(axis=0), 0.5, atol=4e-3)
    windows = Windows((0.3, 0.2), 0.6, (0.0, 0.0, 0.0), np.ones((4, 3)))
    assert windows.radiance(PLACES).mean() == pytest.approx(0.36, abs=4e-3)
    wave = Waves(
        (1.0, 1.0, 1.0), np.array([[2 * np.pi, 0.0]]), np.zeros(1), np.full((1, 3), 0.2)
    )
    lit = Product(Plain((0.5, 0.5, 0.5)), wave).radiance(PLACES)
    assert lit.mean() == pytest.approx(0.5, abs=1e-3)
    assert lit.max() == pytest.approx(0.6, abs=1e-4)

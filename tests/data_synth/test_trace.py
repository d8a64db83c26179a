"""Refraction and surfaces against closed forms: Snell, plates, conics, tori."""

import dataclasses

import numpy as np
import pytest

from data_synth.glass import (
    LINE_C_NM,
    LINE_D_NM,
    LINE_F_NM,
    LINE_G_NM,
    Glass,
    glass_from_abbe,
)
from data_synth.surfaces import Surface, intersect
from data_synth.trace import Stop, trace

GLASS = Glass("cauchy", (1.5, 0.0, 0.0))


def rays(heights_mm, slope=0.0, z_mm=-50.0):
    """Parallel rays in the y-z plane that without glass reach z = 0 at the heights."""
    direction = np.array([0.0, np.sin(slope), np.cos(slope)])
    heights = np.asarray(heights_mm, float)
    foot = np.column_stack([0 * heights, heights, 0 * heights])
    start = foot + z_mm * direction / direction[2]
    return start, np.tile(direction, (len(heights), 1))


def flat(thickness_mm, glass=None):
    surface = Surface(0.0, 0.0, thickness_mm)
    return surface if glass is None else dataclasses.replace(surface, glass=glass)


@pytest.mark.parametrize("slope", [0.0, 0.3, -0.9])
def test_a_plate_shifts_a_ray_sideways_by_the_textbook_amount(slope):
    thickness = 7.0
    surfaces = (flat(thickness, GLASS), flat(20.0))
    traced = trace(surfaces, None, *rays([0.0, 2.0], slope), 550.0)
    inside = np.arcsin(np.sin(slope) / 1.5)
    shift = thickness * (np.tan(inside) - np.tan(slope))
    np.testing.assert_allclose(traced.landing_mm[:, 1], [shift, 2 + shift], atol=1e-12)
    np.testing.assert_allclose(traced.direction[:, 1], np.sin(slope), atol=1e-14)


def test_refraction_obeys_snell_in_the_plane_of_incidence():
    surface = Surface(1 / 30.0, 1 / 30.0, 40.0, glass=GLASS)
    rng = np.random.default_rng(1)
    start = np.column_stack([rng.uniform(-8, 8, (200, 2)), np.full(200, -90.0)])
    direction = np.column_stack([rng.uniform(-0.1, 0.1, (200, 2)), np.ones(200)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    traced = trace((surface,), None, start, direction, 550.0)
    at_vertex = start + np.array([0, 0, 40.0])
    _, normal = intersect(surface, tuple(at_vertex.T), tuple(direction.T))
    normal = np.stack(normal, -1)
    before = np.cross(direction, normal)
    after = 1.5 * np.cross(traced.direction, normal)
    np.testing.assert_allclose(after, before, atol=1e-14)
    assert np.linalg.norm(traced.direction, axis=1) == pytest.approx(1.0, abs=1e-14)


def test_total_reflection_loses_the_ray():
    surfaces = (flat(5.0, GLASS), Surface(-1 / 6.0, -1 / 6.0, 10.0))
    traced = trace(surfaces, None, *rays([0.0, 5.0]), 550.0)
    assert traced.passed.tolist() == [True, False]
    assert np.isnan(traced.landing_mm[1]).all()


def test_ellipsoid_focuses_parallel_light_to_a_point():
    """Conic k = -1/n^2 refracting into glass n is free of spherical aberration."""
    radius = 20.0
    focus = 1.5 * radius / 0.5
    surface = Surface(1 / radius, 1 / radius, focus, glass=GLASS, conic=-1 / 1.5**2)
    traced = trace((surface,), None, *rays(np.linspace(-14, 14, 29)), 550.0)
    assert np.abs(traced.landing_mm).max() < 1e-12


def test_hyperboloid_focuses_light_leaving_glass_to_a_point():
    """Conic k = -n^2 at the rear of a plano-convex lens."""
    radius = 20.0
    focus = radius / 0.5
    surfaces = (
        flat(12.0, GLASS),
        Surface(-1 / radius, -1 / radius, focus, conic=-(1.5**2)),
    )
    traced = trace(surfaces, None, *rays(np.linspace(-10, 10, 21)), 550.0)
    assert np.abs(traced.landing_mm).max() < 1e-12


def test_asphere_terms_can_stand_in_for_a_sphere():
    """sag = c r^2/2 + c^3 r^4/8 + ... : a paraboloid plus even terms is the sphere."""
    curvature = 1 / 50.0
    series = [curvature**3 / 8, curvature**5 / 16, 5 * curvature**7 / 128]
    sphere = Surface(curvature, curvature, 100.0, glass=GLASS)
    asphere = dataclasses.replace(sphere, conic=-1.0, even_coefficients=tuple(series))
    paraboloid = dataclasses.replace(sphere, conic=-1.0)
    bundle = rays(np.linspace(8, 14, 7), 0.1)  # within 4 mm of the axis at the glass
    wanted = trace((sphere,), None, *bundle, 550.0).landing_mm
    # What the series leaves out, 7 c^9 r^10 / 256, bends a ray by 10/r of it.
    bound = 7 * curvature**9 / 256 * 10 * 4.1**9 * 100
    got = trace((asphere,), None, *bundle, 550.0).landing_mm
    assert np.abs(got - wanted).max() < bound < 1e-8
    plain = trace((paraboloid,), None, *bundle, 550.0).landing_mm
    assert np.abs(plain - wanted).max() > 1e-3


def test_rays_meet_a_torus_where_it_is():
    surface = Surface(1 / 40.0, -1 / 25.0, 30.0)
    rng = np.random.default_rng(2)
    start = tuple(np.column_stack([rng.uniform(-6, 6, (50, 2)), np.full(50, -20.0)]).T)
    direction = np.column_stack([rng.uniform(-0.2, 0.2, (50, 2)), np.ones(50)])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    (x, y, z), normal = intersect(surface, start, tuple(direction.T))
    # The section of radius -25 turned about an axis across it, 40 behind the vertex.
    root = np.sqrt(25**2 - y**2)
    reach = 40 - (root - 25)
    np.testing.assert_allclose(np.hypot(x, 40 - z), reach, atol=1e-13)
    slopes = [x / (40 - z), -y / root * reach / (40 - z)]
    np.testing.assert_allclose(-np.stack(normal[:2]) / normal[2], slopes, atol=1e-13)


def test_cylinder_has_power_in_one_section_only():
    lens = (
        Surface(1 / 30.0, 0.0, 0.1, glass=GLASS),
        flat(60.0),
    )
    start = np.array([[0.0, 3.0, -80.0], [3.0, 0.0, -80.0]])
    traced = trace(lens, None, start, np.array([[0.0, 0, 1]] * 2), 550.0)
    assert traced.landing_mm[0].tolist() == [0.0, 3.0]
    assert abs(traced.landing_mm[1, 0]) < 0.1


def test_tilting_a_plate_equals_tilting_the_light():
    angle = 0.2
    tilted = dataclasses.replace(flat(0.0, GLASS), tilt_rad=(angle, 0.0))
    # A rotation about x by +angle turns the axis z towards -y.
    plate = (dataclasses.replace(tilted, thickness_mm=10.0),)
    traced = trace(plate, None, *rays([0.0]), 550.0)
    cosine = traced.direction[0] @ np.array([0.0, -np.sin(angle), np.cos(angle)])
    assert np.sin(np.arccos(cosine)) == pytest.approx(np.sin(angle) / 1.5, abs=1e-14)


def test_decentring_a_lens_carries_its_image_along():
    lens = (Surface(1 / 30.0, 1 / 30.0, 4.0, glass=GLASS), Surface(0.0, 0.0, 55.0))
    moved = tuple(dataclasses.replace(s, decentre_mm=(0.5, -0.2)) for s in lens)
    start, direction = rays([0.0, 1.0, 2.0])
    shift = np.array([0.5, -0.2])
    here = trace(lens, None, start, direction, 550.0).landing_mm
    start[:, :2] += shift
    there = trace(moved, None, start, direction, 550.0).landing_mm
    np.testing.assert_allclose(there, here + shift, atol=1e-13)


@pytest.mark.parametrize("blades", [3, 5, 7, 8])
def test_blades_let_through_as_much_as_the_round_iris(blades):
    grid = (np.arange(801) + 0.5) / 801 * 2 - 1
    x, y = np.meshgrid(grid * 2, grid * 2)
    points = np.column_stack([x.ravel(), y.ravel()])
    edge = Stop(1.0, blades, 0.3).edge_mm(np.arctan2(points[:, 1], points[:, 0]))
    area = (np.hypot(*points.T) < edge).mean() * 16
    assert area == pytest.approx(np.pi, rel=1e-3)


def test_a_blocked_ray_is_traced_but_does_not_pass():
    stop = Surface(0.0, 0.0, 10.0, semi_diameter_mm=5.0, is_stop=True)
    traced = trace((stop,), Stop(2.0), *rays([1.0, 3.0, 6.0]), 550.0)
    assert traced.passed.tolist() == [True, False, False]
    np.testing.assert_allclose(traced.landing_mm[:, 1], [1.0, 3.0, 6.0])


@pytest.mark.parametrize(("index", "abbe"), [(1.5168, 64.17), (1.80518, 25.4)])
def test_a_glass_has_the_index_dispersion_and_partial_asked_for(index, abbe):
    glass = glass_from_abbe(index, abbe)
    g, f, d, c = map(
        glass.refractive_index, (LINE_G_NM, LINE_F_NM, LINE_D_NM, LINE_C_NM)
    )
    assert d == pytest.approx(index, abs=1e-12)
    assert (d - 1) / (f - c) == pytest.approx(abbe, rel=1e-10)
    assert (g - f) / (f - c) == pytest.approx(0.6438 - 0.001682 * abbe, rel=1e-9)

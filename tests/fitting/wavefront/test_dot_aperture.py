"""The dot aperture: its second moments always, its edge where blur is narrow."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import GREY, LAYOUT, SCALE, SINE, Seidel, dots_at
from scipy.special import j1

from lensfit.fitting.wavefront.dot_aperture import (
    dot_aperture_of,
    gaussian_dot_aperture,
    places_in_disc,
    ray_origins_mm,
)
from lensfit.fitting.wavefront.rays import spot_and_pullback
from lensfit.psf.spot import image_of, profile_of

PIXEL_MM, CELLS, RAYS = 0.01, 24, 1536
OVAL = np.array([[0.009, 0.002], [-0.001, 0.006]])


@pytest.mark.parametrize(("count", "off"), [(96, 1.0), (768, 2.5), (1536, 2.5)])
def test_places_fill_a_disc(count, off):
    """Its transform is 2 J1(x)/x, along any direction."""
    places = places_in_disc(count)
    assert np.hypot(*places.T).max() < 1.02
    np.testing.assert_allclose(places.mean(0), 0, atol=1e-12)
    for direction in np.deg2rad([0, 50, 110]):
        along = places @ [np.cos(direction), np.sin(direction)]
        for x in (0.5, 2.0, 4.0):
            found = np.mean(np.exp(1j * x * along))
            assert abs(found - 2 * j1(x) / x) < off * x / count


@pytest.mark.parametrize("blur_mm", [0.0, 0.01, 0.05, 0.5])
def test_second_moments_are_those_of_the_hole(blur_mm):
    diameter = 2 * np.sqrt(np.sum(OVAL**2) / 2 + blur_mm**2)
    hole = dot_aperture_of(OVAL[None], np.array([diameter]))
    places = np.asarray(ray_origins_mm(jnp.asarray(hole.sampled_ellipse_mm[0]), 4096))
    found = places.var(0) + hole.variance_mm2[0]
    np.testing.assert_allclose(found, np.sum(OVAL**2, 1) / 4, rtol=5e-3)


def test_places_have_all_of_a_hole_in_focus_and_nothing_of_one_in_a_wide_blur():
    whole = np.tile(0.01 * np.eye(2), (2, 1, 1))
    hole = dot_aperture_of(whole, np.array([0.02, 2.0]))
    np.testing.assert_allclose(hole.sampled_ellipse_mm[0], whole[0])
    assert not hole.variance_mm2[0].any()
    assert np.abs(hole.sampled_ellipse_mm[1]).max() < 0.05 * whole.max()


def test_a_soft_hole_is_a_gaussian_of_the_same_second_moments():
    hole = gaussian_dot_aperture(OVAL[None])
    assert not hole.sampled_ellipse_mm.any()
    np.testing.assert_allclose(hole.variance_mm2[0], np.sum(OVAL**2, 1) / 4)


def _image(defocus_mm, hole_mm, place_mm):
    """Of a dot behind a perfect lens, and light of very many rays, in numpy alone."""
    lens = Seidel(defocus_mm=(defocus_mm,))
    cone_mm = abs(defocus_mm) * SINE
    dots = dots_at(np.zeros((1, 2)), 0, 0, PIXEL_MM)
    diameter = 2 * np.hypot(cone_mm, np.sqrt(np.sum(hole_mm**2) / 2))
    hole = dot_aperture_of(hole_mm[None], np.array([diameter]))
    dots = dots._replace(
        sampled_ellipse_mm=hole.sampled_ellipse_mm, variance_mm2=hole.variance_mm2
    )
    dot = type(dots)(*(a if a is None else jnp.asarray(a[0]) for a in dots))
    numbers = jnp.asarray(lens.parameters())
    found = _fitted_image(numbers, dot, place_mm)
    return np.asarray(found), _counted(lens, hole_mm, place_mm)


@jax.jit
def _fitted_image(numbers, dot, place_mm):
    spot, _ = spot_and_pullback(numbers, dot, GREY, LAYOUT, SCALE, RAYS)
    profile = profile_of(spot, -place_mm, dot.cell_mm, CELLS, dot.variance_mm2)
    return image_of(spot, profile)


def _counted(lens, hole_mm, place_mm, rays=2_000_000):
    rng = np.random.default_rng(3)
    u = lens.opening(np.zeros(2), 1.0, rays, rng)
    reach, turn = np.sqrt(rng.random(rays)), 2 * np.pi * rng.random(rays)
    left = reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
    x = lens.landing_mm(u, np.zeros(2), 0) + left @ hole_mm.T + place_mm
    edges = PIXEL_MM * np.arange(CELLS + 1)
    counts, _, _ = np.histogram2d(x[:, 1], x[:, 0], (edges, edges))
    return counts / rays


@pytest.mark.slow
@pytest.mark.parametrize("hole_mm", [0.008 * np.eye(2), OVAL], ids=["round", "oval"])
@pytest.mark.parametrize(
    ("defocus_mm", "allowed"),
    [(0.001, 0.015), (0.02, 0.01), (0.06, 0.02), (0.25, 0.025)],
)
def test_the_image_of_a_dot_has_the_rim_of_its_hole(hole_mm, defocus_mm, allowed):
    """From a point blur to one of twelve pixels: against very many rays."""
    place = PIXEL_MM * np.array([11.7, 12.4])
    found, counted = _image(defocus_mm, hole_mm, place)
    assert np.linalg.norm(found - counted) < allowed * np.linalg.norm(counted)

"""Pupil maps against brute force: the same spots, the same photographs, less noise."""

import numpy as np
import pytest

from data_synth.aim import rays_through_pupil, tracer_from_object
from data_synth.chart import Chart, Pose
from data_synth.dots import expose_dots, expose_dots_from_maps
from data_synth.irradiance import ray_weights, shifted_sobol
from data_synth.lens import set_lens
from data_synth.prescription import load_prescription
from data_synth.pupilmap import (
    deposit,
    interpolation,
    open_bounds_mm,
    pupil_map,
)
from data_synth.sensor import Band, Frame, camera_bands
from data_synth.spots import (
    band_chiefs_mm,
    band_maps,
    drawn_spots,
    field_points_mm,
    object_points_mm,
)

FRAME = Frame((256, 192), (24.0, 18.0))
DISTANCE_MM = 2000.0
GREEN = Band("g", (540.0,), (1.0,))


@pytest.fixture(scope="module")
def lens():
    """Out of focus, with vignetting and a bladed iris."""
    return set_lens(
        load_prescription("biotar_50"), f_number=2.0, focus_distance_mm=1430.0, blades=7
    )


def test_interpolation_is_exact_for_cubics():
    coarse, fine = (np.arange(12) + 0.5) / 12, (np.arange(40) + 0.5) / 40
    for power in range(4):
        made = interpolation(12, 40) @ coarse**power
        np.testing.assert_allclose(made, fine**power, atol=1e-13)


def test_deposit_keeps_flux_and_centroid():
    rng = np.random.default_rng(3)
    position, flux = rng.uniform(3, 13, (500, 2)), rng.uniform(0, 1, 500)
    width = rng.uniform(0, 1, (500, 2))
    number = rng.integers(0, 2, 500)
    patches = deposit(position, width, flux, number, (2, 16, 16))
    for k in (0, 1):
        mine = number == k
        np.testing.assert_allclose(patches[k].sum(), flux[mine].sum())
    # A box narrower than a pixel is known to within the pixel; one as wide as a pixel
    # is shared so that the mean stays.
    patch = deposit(position, np.ones((500, 2)), flux, 0 * number, (1, 16, 16))[0]
    centres = np.arange(16) + 0.5
    mean = np.array([patch.sum(0) @ centres, patch.sum(1) @ centres]) / patch.sum()
    np.testing.assert_allclose(mean, flux @ position / flux.sum(), rtol=1e-12)


def test_what_misses_a_patch_is_dropped():
    outside = np.array([[-2.0, 5.0], [5.0, 99.0], [np.inf, 1.0]])
    patch = deposit(
        outside[:2], np.ones((2, 2)), np.ones(2), np.zeros(2, int), (1, 8, 8)
    )
    assert patch.sum() == 0


@pytest.mark.parametrize("parts", [((0.0,), (0.0,)), ((-0.9,), (0.8,))])
def test_spots_are_those_of_brute_force(lens, parts):
    points = field_points_mm(lens, FRAME, parts, DISTANCE_MM)
    centre_mm = band_chiefs_mm(lens, points, GREEN)
    pitch_mm = np.array(FRAME.pitch_mm) / 4
    drawn = drawn_spots(
        band_maps(lens, points, GREEN), GREEN, lens, centre_mm, pitch_mm, 64, 0.25
    )[0]
    scene = tracer_from_object(points)
    lower, upper = open_bounds_mm(lens, scene)
    pupil = lower + (upper - lower) * shifted_sobol(2, 1 << 18, 1, seed=1)[0]
    sources = np.repeat(scene, len(pupil), axis=0)
    traced, direction = rays_through_pupil(lens, sources, pupil, 540.0)
    normals = np.broadcast_to([0.0, 0.0, 1.0], sources.shape)
    weight = ray_weights(lens, sources, normals, direction)[traced.passed]
    place = (-traced.landing_mm[traced.passed] - centre_mm) / pitch_mm + 32
    brute, *_ = np.histogram2d(
        place[:, 1], place[:, 0], bins=64, range=[[0, 64]] * 2, weights=weight
    )
    brute /= brute.sum()
    assert drawn.sum() == pytest.approx(1.0)
    whole = [a.reshape(16, 4, 16, 4).sum((1, 3)) for a in (drawn, brute)]
    error = np.linalg.norm(whole[0] - whole[1]) / np.linalg.norm(whole[1])
    assert error < 4e-3


def test_photographs_are_those_of_brute_force(lens):
    """Flux, centroids and picture to the sampling noise of the rays."""
    chart = Chart("dot-grid", pitch_mm=400.0, mark_mm=8.0)
    pose = Pose(DISTANCE_MM, tilt_deg=8.0, roll_deg=20.0)
    bands = camera_bands(3)
    maps, truth = expose_dots_from_maps(lens, chart, pose, FRAME, bands)
    brute, by_rays = expose_dots(
        lens, chart, pose, FRAME, bands, rays_per_wavelength=1 << 14
    )
    np.testing.assert_array_equal(truth.index, by_rays.index)
    np.testing.assert_allclose(truth.flux, by_rays.flux, rtol=4e-3)
    assert np.abs(truth.centroid_px - by_rays.centroid_px).max() < 0.02
    assert np.linalg.norm(maps - brute) < 0.02 * np.linalg.norm(brute)
    inner = np.abs(truth.chief_px[1] - np.array(FRAME.size_px) / 2) < (90, 60)
    whole = float(truth.flux[:, inner.all(axis=1)].sum())
    assert maps.sum() > whole * 0.999


def test_object_points_are_found_for_wanted_places(lens):
    wanted = np.array([[0.0, 0.0], [10.0, 7.0], [-11.0, 3.0]])
    objects = object_points_mm(lens, wanted, DISTANCE_MM)
    landed = band_chiefs_mm(lens, objects, GREEN)
    np.testing.assert_allclose(landed, wanted, atol=2e-4)


@pytest.mark.parametrize("f_number", [2.8, 5.6])
def test_all_light_of_a_wide_lens_is_in_the_map(f_number):
    """Off axis its stopped-down pupil is far wider than on it: every ray that the glass
    and the stop let through, of a grid five pupils wide, counts."""
    lens = set_lens(
        load_prescription("canon_14"), f_number=f_number, focus_distance_mm=568.0
    )
    objects = np.array([[0.0, 0.0, 568.0], [450.0, 0.0, 568.0]])
    points = tracer_from_object(objects)
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    bounds = open_bounds_mm(lens, points)
    rays = pupil_map(lens, points, normals, bounds, 540.0, 24).refined(lens.stop, 96)
    mapped = rays.flux.sum(axis=(1, 2))
    middle = (bounds[0] + bounds[1]) / 2
    side_mm = 10 * lens.pupil_radius_mm
    axis = ((np.arange(400) + 0.5) / 400 - 0.5) * side_mm
    aim = middle[:, None] + np.stack(np.meshgrid(axis, axis), -1).reshape(1, -1, 2)
    sources = np.repeat(points, axis.size**2, axis=0)
    traced, direction = rays_through_pupil(lens, sources, aim.reshape(-1, 2), 540.0)
    facing = np.broadcast_to([0.0, 0.0, 1.0], sources.shape)
    weight = ray_weights(lens, sources, facing, direction) * traced.passed
    counted = weight.reshape(2, -1).sum(1) * (side_mm / 400) ** 2
    np.testing.assert_allclose(mapped, counted, rtol=0.01)

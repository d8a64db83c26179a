"""The lens from the sensor: the same rays, the same light, as towards the sensor."""

import dataclasses

import numpy as np
import pytest
from scene_lens import GREEN, WHITE, focused, scene_of

from data_synth.aim import rays_through_pupil, tracer_from_object
from data_synth.irradiance import plane_irradiance, shifted_sobol
from data_synth.scene.backward import backward_lens, openings
from data_synth.scene.exposure import mean_radiance
from data_synth.scene.layers import Layer, square_plane
from data_synth.scene.open_light import irradiance_at, open_irradiance
from data_synth.scene.shapes import Everywhere
from data_synth.sensor import Frame
from data_synth.spots import object_points_mm
from data_synth.surfaces import Surface
from data_synth.tolerances import perturbed
from data_synth.trace import Stop

RAYS = 200


def forward_and_back(lens, points_mm, pupil_mm, wavelength_nm):
    """Rays traced to the sensor and, reversed, into the scene again."""
    traced, _ = rays_through_pupil(lens, points_mm, pupil_mm, wavelength_nm)
    slope = -traced.direction[:, :2] / traced.direction[:, 2:]
    rays, clearance = backward_lens(lens).rays_into_scene(
        -traced.landing_mm, slope, wavelength_nm
    )
    return traced, rays, clearance


def scene_points(lens, depth_mm: float, seed: int = 0):
    rng = np.random.default_rng(seed)
    reach = depth_mm * 0.15
    points = np.column_stack(
        [
            rng.uniform(-reach, reach, (RAYS, 2)),
            np.full(RAYS, lens.pupil_z_mm - depth_mm),
        ]
    )
    return points, rng.uniform(-0.9, 0.9, (RAYS, 2)) * lens.pupil_radius_mm


def test_light_takes_the_same_path_both_ways():
    """Through a lens whose elements are decentred and tilted, for two colours."""
    lens = focused("nikkor_28", 2.8, blades=7)
    made = perturbed(lens.prescription, 5, strength=4.0, shape=False)
    lens = dataclasses.replace(lens, surfaces=(*made.surfaces[:-1], lens.surfaces[-1]))
    assert any(surface.is_displaced for surface in lens.surfaces)
    points, pupil = scene_points(lens, 1500.0)
    for wavelength_nm in (450.0, 620.0):
        traced, rays, clearance = forward_and_back(lens, points, pupil, wavelength_nm)
        kept = np.isfinite(traced.landing_mm[:, 0])
        assert kept.mean() > 0.5
        met = rays.pupil_mm + rays.slope * 1500.0
        np.testing.assert_allclose(met[kept], points[kept, :2], atol=1e-8)
        np.testing.assert_allclose(rays.pupil_mm[kept], pupil[kept], atol=1e-9)
        np.testing.assert_allclose(clearance[kept], traced.clearance[kept], atol=1e-9)


def test_an_iris_on_a_curved_surface_stands_behind_it_both_ways():
    lens = focused("cooke_triplet_50", 5.6)
    surfaces = tuple(
        dataclasses.replace(surface, is_stop=number == 3)
        for number, surface in enumerate(lens.surfaces)
    )
    assert surfaces[3].curvature_y_per_mm != 0
    lens = dataclasses.replace(lens, surfaces=surfaces, stop=Stop(3.0))
    points, pupil = scene_points(lens, 1500.0)
    traced, rays, clearance = forward_and_back(lens, points, pupil, 540.0)
    kept = np.isfinite(traced.landing_mm[:, 0])
    np.testing.assert_allclose(rays.pupil_mm[kept], pupil[kept], atol=1e-9)
    np.testing.assert_allclose(clearance[kept], traced.clearance[kept], atol=1e-9)
    assert 0.1 < (clearance >= 0).mean() < 0.9


def test_fall_off_behind_a_hole_is_cosine_to_the_fourth():
    hole = (Surface(0.0, 0.0, 28.0, is_stop=True),)
    lens = dataclasses.replace(
        focused("nikkor_28", 4.0),
        surfaces=hole, stop=Stop(0.5), pupil_z_mm=-28.0, pupil_radius_mm=0.5,
    )  # fmt: skip
    sensor_mm = np.array([[0.0, 0.0], [9.0, 0.0], [-8.0, 6.0], [14.0, 10.0]])
    with np.errstate(divide="ignore"):  # a hole has no focal length
        backward = backward_lens(lens)
    light = irradiance_at(backward, sensor_mm, GREEN)
    cosine = 28.0 / np.hypot(28.0, np.hypot(*sensor_mm.T))
    np.testing.assert_allclose(light / light[0], cosine**4, rtol=1e-3)
    np.testing.assert_allclose(light[0], np.pi * 0.25 / 28.0**2, rtol=2e-3)


@pytest.mark.parametrize(("name", "f_number"), [("biotar_50", 1.4), ("nikkor_28", 2.8)])
def test_light_over_the_opening_is_that_of_brute_force(name, f_number):
    """On the axis and in the corner, where rims cut the pupil."""
    backward = backward_lens(focused(name, f_number, blades=7))
    half_mm = np.array(backward.lens.prescription.sensor_size_mm) / 2
    sensor_mm = np.array([[0.0, 0.0], 0.9 * half_mm])
    outline = irradiance_at(backward, sensor_mm, GREEN)
    boxes = openings(backward, backward.lens.prescription.sensor_size_mm)
    lower, sides = boxes.boxes(sensor_mm)
    # Half again as wide as the boxes: nothing may pass outside them.
    drawn = shifted_sobol(2, 1 << 16, 1, seed=1)[0] * 1.5 - 0.25
    for k, place in enumerate(sensor_mm):
        slope = backward.middle_slope(place[None]) + lower[k] + sides[k] * drawn
        starts = np.tile(place, (len(drawn), 1))
        _, clearance = backward.rays_into_scene(starts, slope, 540.0)
        weight = (clearance >= 0) / (1 + (slope**2).sum(axis=1)) ** 2
        brute = weight.mean() * np.prod(1.5 * sides[k])
        assert outline[k] == pytest.approx(brute, rel=1.5e-3)
        outside = np.abs(drawn - 0.5).max(axis=1) > 0.5
        assert not (clearance[outside] >= 0).any()


def test_a_white_scene_has_the_relative_illumination_of_the_traced_chart():
    """Light gathered backward and light sent forward are the same (etendue)."""
    lens = focused("nikkor_28", 4.0)
    frame = Frame((48, 36), (28.0, 21.0))
    light = open_irradiance(backward_lens(lens), frame, GREEN)
    places = np.array([[0.0, 0.0], [7.0, 5.0], [-12.0, 0.0], [12.0, -9.0]])
    forward = plane_irradiance(lens, object_points_mm(lens, places, 1200.0), 540.0)
    column, row = np.floor(frame.px_from_mm(places)).astype(int).T
    centres = frame.mm_from_px(np.stack([column, row], -1) + 0.5)
    exact = irradiance_at(backward_lens(lens), centres, GREEN)
    np.testing.assert_allclose(light[row, column], exact, rtol=1e-3)
    at_places = irradiance_at(backward_lens(lens), places, GREEN)
    np.testing.assert_allclose(
        at_places / at_places[0], forward / forward[0], rtol=4e-3
    )
    assert at_places[-1] < 0.8 * at_places[0]


def test_a_white_scene_is_white_to_the_last_digit():
    lens = focused("petzval_50", 2.0)
    frame = Frame((24, 18), lens.prescription.sensor_size_mm)
    backward = backward_lens(lens)
    scene = scene_of(Layer("white", square_plane(900.0), Everywhere(), WHITE))
    mean = mean_radiance(
        backward, openings(backward, frame.size_mm), scene, frame, GREEN, 1,
        rays_per_pixel=2, seed=4,
    )  # fmt: skip
    np.testing.assert_allclose(mean, 1.0, rtol=1e-12)


def test_the_axis_is_met_straight_on():
    """The middle of the sensor looks at the middle of the scene, upright."""
    lens = focused("biotar_50", 2.0)
    backward = backward_lens(lens)
    scene_mm = np.array([[60.0, -30.0, 1200.0]])
    points = tracer_from_object(scene_mm)
    traced, _ = rays_through_pupil(lens, points, np.zeros((1, 2)), 540.0)
    slope = -traced.direction[:, :2] / traced.direction[:, 2:]
    rays, _ = backward.rays_into_scene(-traced.landing_mm, slope, 540.0)
    assert (-traced.landing_mm * [[1, -1]] > 0).all()
    np.testing.assert_allclose(
        rays.slope, scene_mm[:, :2] / (1200.0 + lens.pupil_z_mm), atol=1e-9
    )

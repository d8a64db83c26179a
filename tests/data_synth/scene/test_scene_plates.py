"""Pinhole plates: where things appear, how much of a pixel they cover, how deep."""

import numpy as np
import pytest
from scene_lens import WHITE, focused, lamp_layer, scene_of

from data_synth.aim import chief_landings_mm
from data_synth.lens import REFERENCE_NM, set_lens
from data_synth.prescription import load_prescription
from data_synth.scene.layers import Layer, floor_plane, square_plane
from data_synth.scene.paints import Plain
from data_synth.scene.plates import (
    PinholeCamera,
    flat_plate,
    layer_plate,
    pinhole_camera,
    pixel_samples,
)
from data_synth.scene.shapes import Everywhere, Rectangle
from data_synth.sensor import Frame
from data_synth.spots import object_points_mm
from data_synth.tolerances import behind_meniscus

FRAME = Frame((40, 20), (20.0, 10.0))
CAMERA = PinholeCamera(50.0, FRAME, (2, 1))
RED, BLUE = Plain((0.8, 0.1, 0.1)), Plain((0.1, 0.2, 0.7))


def plate_of(*layers: Layer, rays: int = 64):
    scene = scene_of(*layers)
    return flat_plate(CAMERA, scene, pixel_samples(CAMERA, scene, rays, 0))


def over(plates):
    """Laid over each other, nearest first, at the order of each pixel's depths."""
    order = np.argsort(np.stack([p.depth_mm for p in plates]), axis=0, kind="stable")
    colours = np.stack([p.rgba for p in plates])
    out, through = np.zeros_like(plates[0].rgba), np.ones(plates[0].depth_mm.shape)
    for which in order:
        colour = np.take_along_axis(colours, which[None, ..., None], 0)[0]
        out += through[..., None] * colour
        through = through * (1 - colour[..., 3])
    return out


@pytest.mark.parametrize("name", ["biotar_50", "nikkor_28", "kreitzer_135"])
def test_plate_and_lens_agree_in_scale_near_the_axis_at_every_depth(name):
    focus_mm = 30 * focused(name, 5.6).focal_length_mm
    lens = focused(name, 5.6, focus_mm)
    camera = pinhole_camera(lens, Frame((960, 540), (24.0, 13.5)))
    for depth_mm in (0.6 * focus_mm, 3 * focus_mm):
        scene_mm = np.array([[0.004, -0.002, 1.0]]) * depth_mm
        points = scene_mm * [1, 1, -1] + [0, 0, lens.pupil_z_mm]
        landing = chief_landings_mm(lens, points, REFERENCE_NM)
        px = camera.frame.px_from_mm(landing)
        np.testing.assert_allclose(camera.px_of_scene(scene_mm), px, atol=0.01)


def test_overscan_is_ten_percent_or_what_distortion_needs():
    plain = pinhole_camera(focused("biotar_50", 4.0), Frame((960, 540), (24.0, 13.5)))
    assert plain.window == (-48, -27, 960 + 47, 540 + 26)
    # A fisheye: what the corner of its photograph shows is far outside the frame.
    fisheye = behind_meniscus(load_prescription("nikkor_28"))
    lens = set_lens(fisheye, f_number=5.6, focus_distance_mm=800.0)
    camera = pinhole_camera(lens, Frame((260, 195), (26.0, 19.5)))
    corner = object_points_mm(lens, np.array([[13.0, 9.75]]), 800.0)
    seen = camera.px_of_scene(corner + np.array([0, 0, lens.pupil_z_mm]))[0]
    assert seen[0] > 260 + 13
    assert 260 + camera.margin_px[0] >= seen[0]
    assert camera.margin_px[0] < 40 + (seen[0] - 260)


def test_a_rectangle_covers_the_pixels_that_its_projection_covers():
    """Edges at whole and half pixels, 0.5 mm each at the sensor, 50 mm behind."""
    unit = 0.5 * 800.0 / 50.0
    corners = (-3 * unit, -2.5 * unit), (4.5 * unit, 5 * unit)
    plate = plate_of(Layer("card", square_plane(800.0), Rectangle(*corners), RED))
    across = np.zeros(44)
    across[22 - 3 : 22 + 4], across[22 + 4] = 1.0, 0.5
    down = np.zeros(22)
    down[11 - 2 : 11 + 5], down[11 - 3] = 1.0, 0.5
    np.testing.assert_allclose(plate.rgba[..., 3], np.outer(down, across), atol=0.02)
    np.testing.assert_allclose(plate.rgba[..., 0], 0.8 * plate.rgba[..., 3])
    there = plate.rgba[..., 3] > 0
    np.testing.assert_allclose(plate.depth_mm[there], 800.0)
    assert np.isinf(plate.depth_mm[~there]).all()


def test_depth_is_of_what_covers_most_of_a_pixel():
    """A card over 70 %, over 30 %, and a veil that is most of no pixel."""
    unit = 0.5 * 800.0 / 50.0
    back = Layer("back", square_plane(2000.0), Everywhere(), BLUE)
    for covered, expected in ((0.7, 800.0), (0.3, 2000.0)):
        card = Rectangle((-9 * unit, -99.0), (covered * unit, 99.0))
        plate = plate_of(Layer("card", square_plane(800.0), card, RED), back)
        assert plate.depth_mm[10, 22] == expected
        np.testing.assert_allclose(plate.rgba[..., 3], 1.0)
    veil = Layer("veil", square_plane(800.0), Everywhere(), RED, opacity=0.4)
    plate = plate_of(veil, back)
    np.testing.assert_allclose(plate.depth_mm, 2000.0)
    np.testing.assert_allclose(plate.rgba[..., 0], 0.4 * 0.8 + 0.6 * 0.1)


def test_the_floor_is_as_deep_as_its_height_over_the_slope():
    floor = Layer("floor", floor_plane(100.0, 900.0), Everywhere(), RED)
    plate = plate_of(floor, rays=256)
    slope = (np.arange(1, 11) + 0.5) * 0.5 / 50.0
    np.testing.assert_allclose(plate.depth_mm[12:, 7], 100.0 / slope, rtol=0.08)
    assert (np.diff(plate.depth_mm[12:, 7]) < 0).all()
    assert np.isinf(plate.depth_mm[:10]).all()


def test_layers_over_each_other_are_the_flat_plate():
    """Exactly: no pixel is in part covered by two of them."""
    unit = 0.5 * 800.0 / 50.0
    card = Rectangle((-8.3 * unit, -4.4 * unit), (-2.6 * unit, 3.3 * unit))
    sheet = Rectangle((0.4 * unit, -6.7 * unit), (9.3 * unit, 1.2 * unit))
    layers = (
        Layer("card", square_plane(800.0), card, RED),
        Layer("veil", square_plane(1000.0), sheet, WHITE, opacity=0.35),
        lamp_layer(1500.0, (100.0, 70.0), 9.0, 300.0),
        Layer("back", square_plane(2000.0), Everywhere(), BLUE),
    )
    scene = scene_of(*layers)
    samples = pixel_samples(CAMERA, scene, 16, 3)
    flat = flat_plate(CAMERA, scene, samples)
    plates = [layer_plate(CAMERA, layer, samples) for layer in layers]
    np.testing.assert_allclose(over(plates), flat.rgba, atol=1e-12)
    assert flat.rgba.max() > 100


def test_a_lamp_smaller_than_a_pixel_has_its_area():
    radius_px = 0.3
    radius_mm = radius_px * 0.5 * 1500.0 / 50.0
    plate = plate_of(lamp_layer(1500.0, (41.0, -29.0), radius_mm, 500.0), rays=4)
    assert plate.rgba[..., 1].sum() == pytest.approx(
        500 * np.pi * radius_px**2, rel=0.02
    )


def test_a_wire_thinner_than_a_pixel_is_not_lost():
    """A fifth of a pixel wide: its coverage adds up to its area."""
    unit = 0.5 * 800.0 / 50.0
    thin = Rectangle((-99.0, 1.37 * unit), (99.0, 1.57 * unit))
    plate = plate_of(Layer("wire", square_plane(800.0), thin, RED))
    expected = 0.2 * 2 * 99.0 / unit
    assert plate.rgba[..., 3].sum() == pytest.approx(expected, rel=0.03)

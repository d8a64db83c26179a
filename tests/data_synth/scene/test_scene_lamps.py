"""Lamps: the spot of the tracer, cut and crossed by what stands before them."""

import numpy as np
import pytest
from scene_lens import BLACK, FINE, GREEN, WHITE, focused, lamp_layer, scene_of

from data_synth.aim import rays_through_pupil
from data_synth.irradiance import plane_irradiance
from data_synth.lens import SetLens
from data_synth.scene.backward import backward_lens, openings
from data_synth.scene.exposure import mean_radiance
from data_synth.scene.lamp_light import lamp_light
from data_synth.scene.layers import Layer, square_plane
from data_synth.scene.open_light import axis_irradiance, irradiance_at
from data_synth.scene.plates import pinhole_camera
from data_synth.scene.shapes import Discs, Rectangle, Strips
from data_synth.sensor import Frame
from data_synth.spots import band_chiefs_mm, band_maps, drawn_spots

SQUARE = Frame((64, 64), (1.6, 1.6))
FINER = Frame((192, 108), (1.2, 0.675))
LEFT_HALF = Rectangle((-1e4, -1e4), (0.0, 1e4))
"""What is left of the axis."""


@pytest.fixture(scope="module")
def fast() -> SetLens:
    return focused("biotar_50", 2.0)


@pytest.fixture(scope="module")
def slow() -> SetLens:
    """Aberrations of a tenth of a pixel here: similar triangles hold."""
    return focused("biotar_50", 5.6)


def image_of(lens, *layers, frame=FINE, rays: int = 400, seed: int = 1):
    """Green light of the lamps; 1 is white on the axis."""
    white = [axis_irradiance(backward_lens(lens), GREEN)]
    return lamp_light(
        lens, scene_of(*layers), frame, (GREEN,), white,
        rays_per_pixel=rays, seed=seed,
    )[..., 0]  # fmt: skip


@pytest.mark.parametrize("depth_mm", [1143.8, 3000.0, 700.0])
def test_a_small_lamp_is_the_spot_of_the_tracer(fast, depth_mm):
    """In focus, behind and before it: as pupil maps draw it, off the axis."""
    place = np.array([3.0, -2.0]) * depth_mm / 1143.8
    point = np.array([[*place, depth_mm - fast.pupil_z_mm]])
    image = image_of(fast, lamp_layer(depth_mm, place, 1e-3), frame=SQUARE, rays=800)
    maps = band_maps(fast, point, GREEN)
    middle = np.zeros((1, 2))
    spot = drawn_spots(maps, GREEN, fast, middle, np.array(SQUARE.pitch_mm), 64)[0]
    image /= image.sum()
    assert np.linalg.norm(image - spot) < 0.03 * np.linalg.norm(spot)
    rows, columns = np.mgrid[:64, :64] + 0.5
    for axis in (columns, rows):
        moved_px = (image * axis).sum() - (spot * axis).sum()
        assert abs(moved_px) < 0.02
    chief_px = SQUARE.px_from_mm(band_chiefs_mm(fast, point, GREEN))[0]
    assert chief_px[0] > 32
    assert chief_px[1] < 32


@pytest.mark.parametrize("depth_mm", [800.0, 1143.8, 2500.0])
def test_a_lamp_has_the_flux_of_its_image_at_any_depth(slow, depth_mm):
    """Radiance times the area of its pinhole image: light is kept in the lens."""
    radius_mm = 0.4
    image = image_of(slow, lamp_layer(depth_mm, (0.0, 0.0), radius_mm, 300.0))
    focal_mm = pinhole_camera(slow, FINE).focal_length_mm
    radius_px = radius_mm * focal_mm / depth_mm / FINE.pitch_mm[0]
    expected = 300.0 * np.pi * radius_px**2
    assert image.sum() == pytest.approx(expected, rel=4e-3)


def test_a_lamp_and_a_painted_disc_make_the_same_picture(fast):
    """Forward from the lamp, or backward from every pixel: one disc, two ways."""
    depth_mm, place, radius_mm = 2500.0, np.array([4.0, 3.0]), 6.0
    forward = image_of(fast, lamp_layer(depth_mm, place, radius_mm))
    disc = Discs(place[None], np.array([radius_mm]))
    scene = scene_of(Layer("disc", square_plane(depth_mm), disc, WHITE))
    backward = backward_lens(fast)
    mean = mean_radiance(
        backward, openings(backward, FINE.size_mm), scene, FINE, GREEN, 1,
        rays_per_pixel=16, seed=2,
    )  # fmt: skip
    # What remains is the noise of 96 rays a pixel, here in means of 6 x 6 of them.
    assert forward.sum() == pytest.approx(mean.sum(), rel=0.015)
    one, other = (p.reshape(9, 6, 16, 6).mean(axis=(1, 3)) for p in (forward, mean))
    assert np.linalg.norm(one - other) < 0.05 * np.linalg.norm(other)


@pytest.mark.slow
@pytest.mark.parametrize("lamp_mm", [2500.0, 700.0])
@pytest.mark.parametrize("edge_mm", [60.0, 400.0])
def test_an_edge_on_the_axis_cuts_a_disc_in_two(slow, lamp_mm, edge_mm):
    """Half the light; behind the focus, the open side is lit."""
    lamp = lamp_layer(lamp_mm, (0.0, 0.0), 1e-3)
    edge = Layer("edge", square_plane(edge_mm), LEFT_HALF, BLACK)
    whole = image_of(slow, lamp, frame=FINER)
    cut = image_of(slow, lamp, edge, frame=FINER)
    assert cut.sum() / whole.sum() == pytest.approx(0.5, abs=2e-3)
    right, left = cut[:, 97:].sum(), cut[:, :95].sum()
    lit, dark = (right, left) if lamp_mm > 1143.8 else (left, right)
    assert lit > 0.4 * whole.sum()
    assert dark < 0.01 * whole.sum()


def test_a_veil_lets_through_its_share(slow):
    lamp = lamp_layer(2500.0, (0.0, 0.0), 1e-3)
    veil = Layer("veil", square_plane(900.0), LEFT_HALF, WHITE, opacity=0.3)
    behind = Layer("far", square_plane(3000.0), LEFT_HALF, WHITE)
    whole = image_of(slow, lamp)
    assert image_of(slow, lamp, veil).sum() / whole.sum() == pytest.approx(
        0.85, abs=1e-3
    )
    np.testing.assert_array_equal(image_of(slow, lamp, behind), whole)


@pytest.mark.parametrize("wire_mm", [500.0, 900.0])
def test_the_shadow_of_a_wire_lies_where_similar_triangles_put_it(slow, wire_mm):
    """A ray from depth s to pupil point p crosses depth d at p (1 - d/s)."""
    lamp_mm, part, width_mm = 2500.0, 0.35, 0.5
    towards = 1 - wire_mm / lamp_mm
    pupil_mm = np.array([[part * slow.pupil_radius_mm, 0.0]])
    x_mm = pupil_mm[0, 0] * towards
    ends = np.array([[x_mm, -50.0]]), np.array([[x_mm, 50.0]])
    strip = Strips(*ends, np.array([width_mm]))
    wire = Layer("wire", square_plane(wire_mm), strip, BLACK)
    lamp = lamp_layer(lamp_mm, (0.0, 0.0), 1e-3)
    whole = image_of(slow, lamp, frame=FINER)
    lost = whole - image_of(slow, lamp, wire, frame=FINER)
    near_axis = lost[51:57].sum(axis=0)
    at_px = float((near_axis * (np.arange(192) + 0.5)).sum() / near_axis.sum())
    source = np.array([[0.0, 0.0, slow.pupil_z_mm - lamp_mm]])
    traced, _ = rays_through_pupil(slow, source, pupil_mm, 540.0)
    expected_px = FINER.px_from_mm(-traced.landing_mm)[0, 0]
    assert expected_px - 96 > 5
    assert at_px == pytest.approx(expected_px, abs=0.05)
    # A chord of the disc: its share of the area is width times length.
    width = width_mm / towards / slow.pupil_radius_mm
    share = width * 2 * np.sqrt(1 - part**2) / np.pi
    assert lost.sum() / whole.sum() == pytest.approx(share, rel=0.02)


def test_the_white_that_lamps_are_measured_against_is_that_of_the_chart(slow):
    """Both ways round: the irradiance of a white chart, sent forward."""
    forward = plane_irradiance(slow, np.array([[0.0, 0.0, 2000.0]]), 540.0)[0]
    backward = irradiance_at(backward_lens(slow), np.zeros((1, 2)), GREEN)[0]
    assert backward == pytest.approx(forward, rel=2e-3)

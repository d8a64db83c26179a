"""The opening as it was turned, and what lights out of focus look like through it."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adjusted_lenses import (
    CORNER_MM,
    FOCUS_MM,
    ideal,
    landings_um,
    measured,
    measured_preset,
    plain,
)

from lensfit.errors import ImageError
from lensfit.optics.pupil import opening_area, pupil_rays
from lensfit.preset.blocks import AberrationTerm, Pupil

SIZE = 64
AXIS, CORNER = (0.0, 0.0), (0.8 * CORNER_MM, 0.6 * CORNER_MM)
FAR_MM, NEAR_MM = 8000.0, 1200.0
_rays, _area = jax.jit(pupil_rays), jax.jit(opening_area)


def edge(lens, point_mm=AXIS, azimuths=720):
    """Points of the rim of the opening, complex."""
    blur = lens.blur
    h = jnp.asarray(point_mm) / blur.aberration.field_radius_mm
    azimuth = jnp.asarray(np.arange(azimuths) * (2 * np.pi / azimuths))
    u, _ = _rays(h, blur.stop_radius, blur.pupil, azimuth, jnp.ones(azimuths))
    return np.asarray(u) @ [1, 1j]


def area(lens, point_mm=AXIS):
    blur = lens.blur
    h = jnp.asarray(point_mm) / blur.aberration.field_radius_mm
    return float(_area(h, blur.stop_radius, blur.pupil))


def psf(lens, distance_mm=FAR_MM, point_mm=AXIS, **options):
    options = {"pixel_pitch_mm": 0.012, "size_px": SIZE, "tolerance": 0.02} | options
    return np.asarray(lens.psf(point_mm, distance_mm, "g", **options))


def moments(patch):
    """Centroid and second moments along x and y."""
    x = np.arange(len(patch)) + 0.5 - len(patch) / 2
    cx, cy = patch.sum(0) @ x, patch.sum(1) @ x
    return cx, cy, patch.sum(0) @ (x - cx) ** 2, patch.sum(1) @ (x - cy) ** 2


def apart(a, b):
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


@pytest.mark.parametrize("blades", [5, 6, 9])
def test_blades_have_their_symmetry_and_the_area_of_a_round_stop(blades):
    lens = ideal(blades=blades)
    radius = np.abs(edge(lens))
    turned = np.roll(radius, 720 // blades)
    np.testing.assert_allclose(turned, radius, atol=1e-9)
    assert radius.max() / radius.min() > 1.03
    np.testing.assert_allclose(area(lens), np.pi, rtol=1e-3)
    np.testing.assert_allclose(
        np.ptp(np.abs(edge(ideal(blades=blades, roundness=1)))), 0, atol=1e-6
    )


def test_rotation_turns_the_opening_clockwise():
    """From x towards y, which is down: the corners of a hexagon by half a side."""
    straight, turned = (edge(ideal(blades=6, blade_rotation_deg=d)) for d in (0, 30))
    by = np.roll(np.abs(straight), 60)
    np.testing.assert_allclose(np.abs(turned), by, atol=1e-9)


def test_without_a_cats_eye_the_corner_sees_a_round_opening():
    bare = plain(measured_preset(), pupil=Pupil(measured_rims(), (0.05, 0.02)))
    clipped, whole = (edge(measured(bare, cat_eye_gain=g), CORNER) for g in (1.0, 0.0))
    for points, is_round in ((clipped, False), (whole, True)):
        middle = (points.real.max() + points.real.min()) / 2 + 1j * (
            points.imag.max() + points.imag.min()
        ) / 2
        radius = np.abs(points - middle)
        assert (np.ptp(radius) < 0.01) == is_round


def measured_rims():
    return measured_preset().entries[0].blur.pupil.rims


def test_more_of_a_cats_eye_is_what_a_point_farther_out_sees():
    bare = plain(measured_preset(), pupil=Pupil(measured_rims()))
    there = edge(measured(bare), tuple(1.5 * c for c in CORNER))
    found = edge(measured(bare, cat_eye_gain=1.5), CORNER)
    np.testing.assert_allclose(found, there, atol=1e-9)


def test_a_cats_eye_never_closes_the_corner():
    lens = measured(cat_eye_gain=3.0)
    assert 0.02 < area(lens, CORNER) / area(lens) < 0.5


@pytest.mark.parametrize("percent", [20.0, 60.0])
def test_a_stated_cats_eye_hides_its_share_of_the_corner(percent):
    lens = ideal(cat_eye_percent=percent)
    foreshortening = area(ideal(blades=8, roundness=1.0), CORNER) / np.pi
    found = area(lens, CORNER) / area(lens) / foreshortening
    np.testing.assert_allclose(found, 1 - percent / 100, atol=0.01)


def test_the_squeeze_draws_the_blur_out():
    """Twice as high as wide, and of the same area: the kernel on stretched pixels."""
    oval = psf(ideal(squeeze=2.0))
    half = 2**0.5
    plain_lens = ideal(blades=12, roundness=1.0)
    same = psf(plain_lens, pixel_pitch_mm=(0.012 * half, 0.012 / half))
    assert apart(oval, same) < 0.02
    *_, wide, high = moments(oval)
    np.testing.assert_allclose(high / wide, 4, rtol=0.03)


@pytest.mark.parametrize("b", [3.0, 1.0, -0.5, -4.0])
def test_ring_brightness_keeps_the_light_and_moves_it(b):
    """The mean squared radius of (1 + b) x^b is (1 + b) / (2 + b), with b < 0 that of
    (1 + |b|) (1 - x)^|b| 1 / (2 + |b|), and of an even disc 1/2."""
    even, ringed = (
        psf(ideal(blades=12, roundness=1.0, ring_brightness=r)) for r in (1e-9, b)
    )
    assert ringed.sum() == pytest.approx(1, abs=1e-9)
    share = (1 + b) / (2 + b) if b > 0 else 1 / (2 - b)
    ratio = sum(moments(ringed)[2:]) / sum(moments(even)[2:])
    np.testing.assert_allclose(ratio, 2 * share, rtol=0.02)


@pytest.fixture
def pictures(tmp_path):
    """A disc, and a disc whose lower right quarter is dark."""
    t = (np.arange(400) + 0.5) / 200 - 1
    inside = 255 * (t**2 + t[:, None] ** 2 <= 1)
    cv2.imwrite(str(tmp_path / "disc.png"), inside.astype(np.uint8))
    inside[200:, 200:] = 0
    cv2.imwrite(str(tmp_path / "three.png"), inside.astype(np.uint8))
    cv2.imwrite(str(tmp_path / "dark.png"), np.zeros((8, 8), np.uint8))
    return tmp_path


def test_a_disc_as_filter_is_the_round_opening(pictures):
    found = psf(ideal(filter_image=str(pictures / "disc.png")))
    assert apart(found, psf(ideal(blades=12, roundness=1.0))) < 0.04


def test_a_filter_stands_upright_beyond_the_focus_and_turned_before_it(pictures):
    lens = ideal(filter_image=str(pictures / "three.png"))
    beyond, before = psf(lens), psf(lens, NEAR_MM)
    assert beyond.sum() == pytest.approx(1) == before.sum()
    h = SIZE // 2
    quarters = [[beyond[:h, :h], beyond[:h, h:]], [beyond[h:, :h], beyond[h:, h:]]]
    light = np.array([[q.sum() for q in row] for row in quarters])
    np.testing.assert_allclose(light, [[1 / 3, 1 / 3], [1 / 3, 0]], atol=0.02)
    x, y, *_ = moments(beyond)
    nx, ny, *_ = moments(before)
    assert min(-x, -y, nx, ny) > 0.5


def test_a_filter_grows_with_the_circle_of_confusion(pictures):
    """At twice the f-number everything is half as large."""
    name = str(pictures / "three.png")
    wide = psf(ideal(2.0, filter_image=name))
    narrow = psf(ideal(4.0, filter_image=name), pixel_pitch_mm=0.006)
    assert apart(narrow, wide) < 0.05


def test_rotation_turns_the_filter_clockwise(pictures):
    name = str(pictures / "three.png")
    turned = psf(ideal(filter_image=name, blade_rotation_deg=90))
    assert apart(turned, np.rot90(psf(ideal(filter_image=name)), -1)) < 0.04


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("dark.png", r"dark.png: lets no light .* give --filter-image a"),
        ("none.png", r"none.png: cannot be read .* with --filter-image"),
    ],
)
def test_a_filter_that_cannot_be_used_is_named(pictures, name, said):
    with pytest.raises(ImageError, match=said):
        ideal(filter_image=str(pictures / name))


def test_largest_blur_holds_depth_and_nothing_else():
    """A radius of .5 % of the width: beyond it every distance looks alike."""
    lens = ideal(blades=12, roundness=1.0, maximum_blur_percent=0.5)
    radius_px = 0.005 * 24.89 / 0.012
    near, nearest = psf(lens, NEAR_MM), psf(lens, 500.0)
    np.testing.assert_array_equal(near, nearest)
    *_, wide, high = moments(nearest)
    np.testing.assert_allclose(
        np.sqrt(wide + high - 1 / 6) * 2**0.5, radius_px, rtol=0.02
    )
    base = ideal(blades=12, roundness=1.0)
    still = psf(lens, 2100.0)
    np.testing.assert_array_equal(still, psf(base, 2100.0))


@pytest.mark.slow
def test_rays_that_nobody_measured_are_aberrated_as_the_nearest_that_was():
    """Straight blades reach beyond the widest opening, where a term of the tenth order
    would throw rays far away; its size at the rim is the farthest that they go."""
    steep = AberrationTerm(10, 0, 0, 0, "re", 30.0)
    preset = plain(measured_preset(steep), pupil=Pupil(), focus_offset_mm=0.0)
    stop = max(float(measured(preset).blur.stop_radius), 1.0)
    rim_um = np.abs(landings_um(measured(preset), AXIS, [(stop, 0.0)])).max()
    lens = measured(preset, blades=3, roundness=0.0)
    wider = psf(lens, FOCUS_MM, pixel_pitch_mm=3.3e-3 * rim_um / (SIZE / 2))
    third = SIZE // 3
    assert wider[third:-third, third:-third].sum() > 0.999

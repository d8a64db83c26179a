"""Depth of field by its physics: energy, constancy, order, translucency, points."""

import cv2
import jax
import numpy as np
import pytest
from ideal_lens import (
    HEIGHT,
    WIDTH,
    depth_of,
    depth_plane,
    disc,
    ideal_lens,
    noise,
)
from scipy.special import j1

from lensfit.coords import Window
from lensfit.rendering.frame import render
from lensfit.rendering.layer_stack import LayerStack, Mattes

LENS = ideal_lens()
FRAME = Window.of_size(WIDTH, HEIGHT)


def blurred(picture, radius_px):
    """Each channel convolved with a disc, the border continued."""
    kernel = disc(abs(radius_px), int(np.ceil(abs(radius_px))) + 1)
    return cv2.filter2D(
        picture.astype(float), -1, kernel, borderType=cv2.BORDER_REPLICATE
    )


@pytest.mark.parametrize("tolerance", [1e-2, 3e-3, 1e-3, 3e-4])
@pytest.mark.parametrize("radius", [-1.2, -3.3, 5.7, 11.0, 24.0])
def test_waves_fade_as_those_that_a_disc_averages(radius: float, tolerance: float):
    """A wave of frequency f over a disc of radius r is 2 J1(q) / q of itself, with
    q = 2 pi f r."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    rng = np.random.default_rng(2)
    picture, expected = np.full((2, HEIGHT, WIDTH), 0.5)
    for frequency in (0.02, 0.05, 0.1, 0.15):
        turn, phase = rng.uniform(0, 2 * np.pi, 2)
        along = np.cos(turn) * x + np.sin(turn) * y
        wave = 0.1 * np.sin(2 * np.pi * frequency * along + phase)
        q = 2 * np.pi * frequency * abs(radius)
        picture, expected = picture + wave, expected + wave * 2 * j1(q) / q
    plate = np.repeat(picture[..., None], 3, -1).astype(np.float32)
    found = render(plate, depth_plane(radius), LENS, tolerance=tolerance)
    inside = np.s_[36:-36, 36:-36]
    away = (found[..., 1] - expected)[inside]
    assert np.sqrt(np.mean(away**2)) < max(1.5 * tolerance, 2e-3)


def test_what_is_in_focus_comes_back_bit_for_bit():
    picture = noise()
    assert render(picture, depth_plane(0.0), LENS).tobytes() == picture.tobytes()
    near_enough = depth_plane(0.0) * np.float32(1.0001)
    assert render(picture, near_enough, LENS).tobytes() == picture.tobytes()


def test_a_constant_stays_constant_whatever_the_depth():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    depth = depth_of(6 * np.sin(x / 17) * np.cos(y / 13))
    depth[40:90, 60:120] = depth_of(9.0)
    depth[20:30, :] = np.inf
    picture = np.tile(np.float32([0.7, 0.5, 0.3]), (HEIGHT, WIDTH, 1))
    found = render(picture, depth.astype(np.float32), LENS)
    assert np.abs(found - picture).max() < 1e-5


@pytest.mark.parametrize("value", [0.5, 400.0])
@pytest.mark.parametrize("place", [(70, 100), (30, 40), (110, 170)])
def test_a_point_keeps_its_light_and_its_image_is_the_kernel(
    value: float, place: tuple[int, int]
):
    picture = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    picture[place] = value
    found = render(picture, depth_plane(-3.3), LENS)
    assert found.sum((0, 1)) == pytest.approx(3 * [value], rel=1e-3)
    row, column = place
    patch = found[row - 12 : row + 13, column - 12 : column + 13, 1] / value
    point_mm = (np.array([column, row]) + 0.5 - [WIDTH / 2, HEIGHT / 2]) * 36 / WIDTH
    kernel = np.asarray(
        LENS.psf(point_mm, float(depth_of(-3.3)), pixel_pitch_mm=36 / WIDTH, size_px=25)
    )
    assert np.linalg.norm(patch - kernel) < 0.04 * np.linalg.norm(kernel)


def test_the_rim_of_a_bright_light_is_true_to_a_tenth_of_a_pixel():
    """A light of four pixels whose distance lies between coarse levels."""
    for radius in (5.03, 5.41, 5.77):
        picture = np.full((HEIGHT, WIDTH, 3), 0.02, np.float32)
        picture[69:71, 99:101] = 500.0
        found = render(picture, depth_plane(radius), LENS, tolerance=1e-2)
        lit = found[..., 1] - 0.02
        flux = 4 * (500 - 0.02)
        assert lit.sum() == pytest.approx(flux, rel=1e-3)
        # second moment: disc, four pixels, a third of a pixel's own square
        y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        square = (lit * ((x - 100) ** 2 + (y - 70) ** 2)).sum() / flux
        assert np.sqrt(2 * (square - 0.5 - 1 / 54)) == pytest.approx(radius, abs=0.1)


def half_step(near_px, far_px):
    """Near left half, far right half."""
    depth = depth_plane(far_px)
    depth[:, : WIDTH // 2] = depth_of(near_px)
    picture = np.empty((HEIGHT, WIDTH, 3), np.float32)
    picture[:, : WIDTH // 2], picture[:, WIDTH // 2 :] = (
        (0.8, 0.2, 0.1),
        (0.1, 0.3, 0.6),
    )
    return picture, depth


def test_a_sharp_near_edge_is_not_touched_by_the_far_blur():
    picture, depth = half_step(0.0, -8.0)
    found = render(picture, depth, LENS)
    assert np.abs(found - picture).max() < 2e-3


def test_a_near_blur_spreads_over_the_sharp_far_side():
    picture, depth = half_step(8.0, 0.0)
    found = render(picture, depth, LENS)
    cover = blurred(
        np.float32(np.arange(WIDTH) < WIDTH // 2)[None].repeat(HEIGHT, 0), 8.0
    )
    expected = (
        cover[..., None] * picture[0, 0] + (1 - cover[..., None]) * picture[0, -1]
    )
    assert np.abs(found - expected).max() < 0.02
    # and the far side shows through within the edge, where the plate hid it
    assert found[70, WIDTH // 2 - 4, 2] > 0.2


def test_half_a_frame_of_depth_agrees_with_rays():
    """Both sides out of focus: pupil points by pupil points, nearest thing first."""
    picture, depth = half_step(6.0, -4.0)
    found = render(picture, depth, LENS)
    u = np.stack(np.meshgrid(*2 * [np.linspace(-1, 1, 81)]), -1).reshape(-1, 2)
    u = u[(u**2).sum(-1) <= 1]
    x = np.arange(WIDTH) + 0.5
    near = (x[:, None] - 6.0 * u[:, 0]) < WIDTH / 2
    cover = near.mean(1)[None, :, None]
    expected = cover * picture[0, 0] + (1 - cover) * picture[0, -1]
    assert np.abs(found[40:100] - expected).max() < 0.02


def test_a_thin_wire_in_front_turns_translucent_by_its_width():
    """A bar of width w blurred to radius r > w covers 2 w / pi r where it was."""
    picture = np.full((HEIGHT, WIDTH, 3), 0.6, np.float32)
    depth = depth_plane(0.0)
    picture[:, 99:102], depth[:, 99:102] = 0.05, depth_of(10.0)
    found = render(picture, depth, LENS, tolerance=1e-3)
    chord = 2 * (1.5 * np.sqrt(100 - 1.5**2) + 100 * np.arcsin(0.15)) / (np.pi * 100)
    expected = 0.05 * chord + 0.6 * (1 - chord)
    assert found[70, 100] == pytest.approx(3 * [expected], abs=3e-3)
    assert np.abs(found[:, 115:] - 0.6).max() < 2e-3


def test_mixed_pixels_of_an_edge_are_taken_apart():
    """An anti-aliased edge at a third of a pixel, its depth aliased: the blur of both
    sides is as if the edge were known."""
    picture, depth = half_step(7.0, 0.0)
    mixed = WIDTH // 2
    picture[:, mixed] = picture[0, 0] / 3 + picture[0, -1] * 2 / 3
    cover = np.float32(np.arange(WIDTH) < mixed)
    cover[mixed] = 1 / 3
    cover = blurred(cover[None].repeat(HEIGHT, 0), 7.0)[..., None]
    expected = cover * picture[0, 0] + (1 - cover) * picture[0, -1]
    for owner in (7.0, 0.0):  # depth may be of either side
        depth[:, mixed] = depth_of(owner)
        found = render(picture, depth, LENS)
        assert np.abs(found - expected).max() < 0.02


def test_a_cryptomatte_tells_what_colour_cannot():
    """Both sides of one colour but for a stripe: only coverage knows the edge."""
    picture, depth = half_step(7.0, 0.0)
    mixed = WIDTH // 2
    near = np.float32(np.arange(WIDTH) < mixed)
    near[mixed] = 0.5
    ids = np.zeros((2, HEIGHT, WIDTH), np.uint32)
    ids[0], ids[1] = 11, 0
    ids[0, :, mixed:], ids[1, :, mixed] = 22, 11
    coverage = np.zeros((2, HEIGHT, WIDTH), np.float32)
    coverage[0], coverage[0, :, mixed], coverage[1, :, mixed] = 1, 0.5, 0.5
    picture[:, mixed] = (picture[0, 0] + picture[0, -1]) / 2
    found = render(picture, depth, LENS, mattes=Mattes(ids, coverage))
    cover = blurred(near[None].repeat(HEIGHT, 0), 7.0)[..., None]
    expected = cover * picture[0, 0] + (1 - cover) * picture[0, -1]
    assert np.abs(found - expected).max() < 0.02


def test_the_hidden_layers_of_a_deep_plate_are_what_shows():
    front = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    front[:, :100] = (0.5, 0.5, 0.5, 1)
    back = np.ones((HEIGHT, WIDTH, 4), np.float32)
    back[:, :90, :3], back[:, 90:, :3] = (1, 0, 0), (0, 0, 1)
    depth = np.stack([depth_plane(8.0), depth_plane(0.0)])
    found = render(LayerStack(np.stack([front, back]), depth), None, LENS)
    # 6 px inside the edge the red of the hidden part shows, not the blue beside it
    assert found[70, 94, 0] == pytest.approx(0.5 * (1 - found[70, 94, 2]), abs=0.5)
    cover = blurred(front[..., 3], 8.0)
    assert (
        np.abs(found[..., 2] - (cover * 0.5 + (1 - cover) * back[..., 2])).max() < 5e-3
    )
    assert (
        np.abs(found[..., 0] - (cover * 0.5 + (1 - cover) * back[..., 0])).max() < 5e-3
    )
    assert np.abs(found[..., 3] - 1).max() < 1e-5


def test_alpha_blurs_with_its_colour():
    picture = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    picture[50:90, 80:120] = (0.4, 0.2, 0.1, 0.8)
    picture = cv2.GaussianBlur(picture, (0, 0), 1.5)
    depth = depth_plane(6.0)
    found = render(picture, depth, LENS, tolerance=1e-4)
    assert np.abs(found - blurred(picture, 6.0)).max() < 3e-3


@pytest.mark.parametrize("radius", [0.6, 1.2])
def test_no_light_is_taken_off_beside_a_sharp_outline(radius: float):
    """A little out of focus surfaces are read by a cubic, which swings below zero."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    cover = np.clip(30.5 - np.hypot(x - WIDTH / 2, y - HEIGHT / 2), 0, 1)
    element = np.stack([0.9 * cover, 0.5 * cover, 0.7 * cover, cover], -1)
    element = element.astype(np.float32)
    found = render(element, depth_plane(radius), LENS)
    assert found.min() >= 0
    assert found.sum((0, 1)) == pytest.approx(element.sum((0, 1)), rel=1e-3)
    # What is below zero itself, as black levels taken off noise are, stays so.
    below = element.copy()
    below[:24, :24, :3] = -0.25
    kept = render(below, depth_plane(radius), LENS)
    assert kept[4:16, 4:16, :3] == pytest.approx(-0.25, abs=1e-4)


def test_the_border_of_a_plate_with_overscan_is_not_darkened():
    window = FRAME.grown(20, 20)
    picture = np.full((HEIGHT + 40, WIDTH + 40, 3), 0.5, np.float32)
    depth = np.full(picture.shape[:2], depth_of(9.0), np.float32)
    found = render(picture, depth, LENS, data_window=window, display_window=FRAME)
    assert found.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(found - 0.5).max() < 1e-5


def test_a_tighter_tolerance_comes_closer():
    radius = np.linspace(-6, 12, HEIGHT)[:, None].repeat(WIDTH, 1)
    depth = depth_of(radius).astype(np.float32)
    fine = render(noise(3), depth, LENS, tolerance=3e-4)
    errors = [
        np.sqrt(np.mean((render(noise(3), depth, LENS, tolerance=t) - fine) ** 2))
        for t in (1e-3, 1e-2)
    ]
    assert errors[0] < errors[1] < 0.05
    assert errors[0] < 5e-3


@pytest.mark.skipif(jax.default_backend() == "cpu", reason="JAX sees no GPU")
def test_a_gpu_makes_the_same_picture():
    picture, depth = half_step(6.0, -4.0)
    picture[60:62, 50:52] = 300.0
    found = render(picture, depth, LENS)
    with jax.default_device(jax.devices("cpu")[0]):
        same = render(picture, depth, LENS)
    assert np.abs(np.clip(found, 0, 1) - np.clip(same, 0, 1)).max() < 1e-3

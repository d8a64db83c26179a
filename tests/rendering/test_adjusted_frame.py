"""Knobs in the rendered frame: shapes of lights, energy, limits of blur, levels."""

import cv2
import numpy as np
import pytest
from ideal_lens import FOCUS_MM, HEIGHT, WIDTH, depth_of, depth_plane, noise

from lensfit.coords import Window
from lensfit.preset.knobs import NEUTRAL, adjusted_knobs
from lensfit.preset.thin_lens import ThinCamera, thin_lens_preset
from lensfit.rendering.circle import Circle
from lensfit.rendering.frame import render
from lensfit.rendering.plate_defocus import Defocus
from lensfit.rendering.uv import PlateGeometry

MIDDLE = np.s_[HEIGHT // 2, WIDTH // 2]
FRAME = Window.of_size(WIDTH, HEIGHT)


def lens_of(**knobs):
    camera = ThinCamera(50.0, 2.0, FOCUS_MM / 1000, 36.0, WIDTH, HEIGHT)
    preset = thin_lens_preset(camera)
    return preset.at(focus_distance_mm=FOCUS_MM, knobs=adjusted_knobs(NEUTRAL, knobs))


@pytest.fixture(scope="module")
def three_quarters(tmp_path_factory):
    """A disc without its lower right quarter."""
    path = tmp_path_factory.mktemp("filter") / "three.png"
    t = (np.arange(200) + 0.5) / 100 - 1
    inside = 255 * (t**2 + t[:, None] ** 2 <= 1)
    inside[100:, 100:] = 0
    cv2.imwrite(str(path), inside.astype(np.uint8))
    return str(path)


def a_light(power=1.0):
    picture = np.full((HEIGHT, WIDTH, 3), 1e-6, np.float32)
    picture[MIDDLE] = power
    return picture


@pytest.mark.slow
@pytest.mark.parametrize("power", [0.5, 400.0])
def test_a_filter_shows_upright_behind_and_turned_in_front(three_quarters, power):
    """The same for a dim point, which is convolved, and for a light of its own."""
    lens = lens_of(filter_image=three_quarters)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    lower_right = (y > HEIGHT // 2 + 1) & (x > WIDTH // 2 + 1)
    upper_left = (y < HEIGHT // 2 - 1) & (x < WIDTH // 2 - 1)
    for radius_px, empty, full in (
        (-9.0, lower_right, upper_left),
        (9.0, upper_left, lower_right),
    ):
        found = render(a_light(power), depth_plane(radius_px), lens)[..., 1] / power
        assert found.sum() == pytest.approx(1, abs=0.07)
        assert found[empty].sum() < 0.03
        assert found[full].sum() > 0.2


@pytest.mark.slow
@pytest.mark.parametrize(
    "knobs",
    [
        {"blades": 6},
        {"squeeze": 1.8},
        {"ring_brightness": 2.0},
        {"cat_eye_percent": 30.0, "optical_vignetting_gain": 0.0},
    ],
    ids=str,
)
def test_every_shape_keeps_the_light(knobs):
    power = 200.0
    found = render(a_light(power), depth_plane(-8.0), lens_of(**knobs))[..., 1]
    assert found.sum() == pytest.approx(power + 1e-6 * found.size, rel=2e-3)
    assert found.max() < 0.05 * power


def test_a_squeezed_light_is_twice_as_high_as_wide():
    found = render(a_light(300.0), depth_plane(-8.0), lens_of(squeeze=2.0))[..., 1]
    rows, columns = np.nonzero(found > 0.3 * found.max())
    high, wide = np.ptp(rows) + 1, np.ptp(columns) + 1
    assert high / wide == pytest.approx(2, rel=0.12)


@pytest.mark.parametrize("squeeze", [0.25, 2.0, 4.0])
def test_a_squeeze_keeps_the_area_of_the_blur_and_treats_alpha_as_colour(squeeze):
    """Of a disc of radius R the second moments are R^2 / 4 each; of an ellipse of the
    same area their product is the same, and their ratio the square of the squeeze."""
    radius_px, half = 8.0, 6
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    middle = np.s_[
        HEIGHT // 2 - half : HEIGHT // 2 + half, WIDTH // 2 - half : WIDTH // 2 + half
    ]
    rgba[middle] = 0.6, 0.6, 0.6, 1.0
    lens = lens_of(squeeze=squeeze)
    found = render(rgba, depth_plane(-radius_px), lens, tolerance=5e-5).astype(float)
    alpha = found[..., 3]
    assert np.abs(found[..., :3] - 0.6 * alpha[..., None]).max() < 1e-6
    assert alpha.sum() == pytest.approx(4 * half**2, rel=1e-5)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    high, wide = (
        (alpha * (at - (alpha * at).sum() / alpha.sum()) ** 2).sum() / alpha.sum()
        - half**2 / 3
        for at in (y, x)
    )
    assert high * wide == pytest.approx((radius_px**2 / 4) ** 2, rel=0.02)
    assert high / wide == pytest.approx(squeeze**2, rel=0.02)
    assert alpha.min() >= 0
    assert alpha.max() <= 1


def test_blades_that_are_round_make_the_disc_of_the_closed_form():
    """The rays of a turned lens and the disc of an ideal one, by the tolerance."""
    plain, round_blades = (
        render(noise(), depth_plane(-7.0), lens)
        for lens in (lens_of(), lens_of(blades=8, roundness=1.0))
    )
    assert np.sqrt(np.mean((plain - round_blades) ** 2)) < 1e-3


def test_the_largest_blur_is_a_limit_of_depth():
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    radius = 2 + 11 * np.sin(x / 30) * np.cos(y / 25)
    limit_px = 5.0
    lens = lens_of(maximum_blur_percent=100 * limit_px / WIDTH)
    held = render(noise(), depth_of(radius).astype(np.float32), lens)
    clipped = np.clip(radius, -limit_px, limit_px)
    expected = render(noise(), depth_of(clipped).astype(np.float32), lens_of())
    assert np.abs(held - expected).max() < 2e-3
    within = depth_of(0.35 * radius).astype(np.float32)
    assert render(noise(), within, lens).tobytes() == (
        render(noise(), within, lens_of()).tobytes()
    )


def test_no_blur_at_all_is_the_plate():
    depth = depth_of(np.linspace(-9, 9, WIDTH) * np.ones((HEIGHT, 1))).astype(
        np.float32
    )
    found = render(noise(), depth, lens_of(maximum_blur_percent=0.0))
    assert found.tobytes() == noise().tobytes()


@pytest.mark.parametrize("count", [2, 5, 24])
def test_depth_is_cut_into_as_many_levels_as_are_wanted(count):
    defocus = Defocus(lens_of(), PlateGeometry.of(lens_of(), FRAME), 1e-3, count)
    radius = np.linspace(-11.3, 6.2, 5000, dtype=np.float32)
    slabs = defocus.slabs(float(radius.min()), float(radius.max()))
    cuts = slabs.cuts_px([radius])
    assert count - 1 <= len(cuts) <= 2 * count
    edges = np.array([6.2, *cuts, -11.3])
    assert (-np.diff(edges)).max() > 0.4 * (11.3 + 6.2) / count


@pytest.mark.slow
def test_more_levels_come_closer_to_the_finest():
    depth = depth_of(np.linspace(-9, 9, WIDTH) * np.ones((HEIGHT, 1))).astype(
        np.float32
    )
    finest = render(noise(), depth, lens_of(), tolerance=1e-4)
    rms = [
        np.sqrt(
            np.mean((render(noise(), depth, lens_of(), depth_levels=n) - finest) ** 2)
        )
        for n in (4, 12, 60)
    ]
    assert rms[0] > 2 * rms[1] > 4 * rms[2]


def test_the_limit_holds_in_pixels_of_the_plate():
    lens = lens_of(maximum_blur_percent=2.0)
    circle = Circle.of(lens, PlateGeometry.of(lens, FRAME))
    radius = circle.radius_px(np.array([50.0, 200.0, FOCUS_MM, 9e9], np.float32))
    assert radius.max() == pytest.approx(0.02 * WIDTH)
    assert radius.min() >= -0.02 * WIDTH

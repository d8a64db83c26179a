"""Glare: light is moved or scattered, and never lost.

The halo of bloom grows with the blur that its light arrives in. Pro-mist and diffusion
scatter a known share of all light.
"""

import numpy as np
import pytest
from look_makers import (
    FOCUS_MM,
    HEIGHT,
    WIDTH,
    depth_plane,
    grey,
    looked,
    noise,
    with_light,
    within,
)

from lensfit.rendering.look.glare import SharpLayer, blur_of_light, picture_with_bloom

CENTRE = (120.5, 80.5)


def bloom_of(picture, gain=0.5, **knobs):
    """What was added, and what was taken away."""
    change = looked(picture, bloom_gain=gain, **knobs) - picture
    return np.maximum(change, 0), np.maximum(-change, 0)


def test_a_share_of_the_light_above_the_threshold_goes_into_the_halo():
    picture = with_light(80, 120, 101.0)
    for gain in (0.1, 0.5, 1.0):
        made = looked(picture, bloom_gain=gain)
        assert made.sum(dtype=float) == pytest.approx(picture.sum(), rel=1e-5)
        back = made[80, 120, 1] - (101 - 100 * gain)  # of the halo, on its own pixel
        assert made[80, 121, 1] < back < 1.3 * made[80, 121, 1]


def test_half_of_the_halo_lies_within_its_size():
    picture = with_light(80, 120, 101.0)
    for percent in (2.0, 4.0):
        made = looked(picture, bloom_gain=1.0, bloom_size_percent=percent)
        halo = made[..., 1].astype(float)
        halo[80, 120] -= 1  # what is below the threshold stays
        radius = percent / 100 * WIDTH
        assert within(halo, CENTRE, radius) == pytest.approx(0.5, abs=0.04)


def test_what_is_dim_does_not_bloom():
    dim = noise(low=0.0, high=0.5)
    assert looked(dim, bloom_gain=1.0).tobytes() == dim.tobytes()


def test_bloom_is_linear_in_exposure_when_the_threshold_follows():
    picture = noise()
    one = looked(picture, bloom_gain=0.4, bloom_threshold=1.0)
    four = looked(4 * picture, bloom_gain=0.4, bloom_threshold=4.0)
    assert four == pytest.approx(4 * one, rel=1e-5)


def test_above_the_knee_a_stop_more_adds_its_own_bloom():
    # Linear in the light above the threshold, wherever that is beyond the knee.
    halos = [bloom_of(with_light(80, 120, 1 + light))[0] for light in (100, 200)]
    assert halos[1] == pytest.approx(2 * halos[0], rel=1e-4, abs=1e-7)


def half_light_radius(plane):
    y, x = np.indices(plane.shape) + 0.5
    r = np.hypot(x - CENTRE[0], y - CENTRE[1]).ravel()
    order = np.argsort(r)
    light = np.cumsum(plane.ravel()[order], dtype=float)
    return r[order][np.searchsorted(light, light[-1] / 2)]


def test_the_farther_out_of_focus_the_wider():
    picture, more = with_light(80, 120, 3e4), []
    for distance in (FOCUS_MM, 800.0, 500.0):
        depth = depth_plane(distance)
        plain = looked(picture, depth)
        made = [
            looked(picture, depth, bloom_gain=1.0, bloom_threshold=0, bloom_growth=g)
            for g in (0.0, 1.0)
        ]
        still, grown = (half_light_radius(m[..., 1]) for m in made)
        more.append(grown - still)
        assert made[1].sum() == pytest.approx(plain.sum(), rel=1e-4)
    assert more[0] == 0
    assert 0.5 < more[1] < more[2]


def test_the_size_is_that_of_both_in_quadrature():
    picture = with_light(80, 120, 101.0)
    more = np.full((HEIGHT // 4, WIDTH // 4), 8.0, np.float32)
    grown = picture_with_bloom(picture, 1.0, 1.0, 6.0, 2.0, more)[..., 1].astype(float)
    grown[80, 120] -= 1
    assert within(grown, CENTRE, 10.0) == pytest.approx(0.5, abs=0.04)
    assert grown.sum() == pytest.approx(100, rel=1e-4)
    none = picture_with_bloom(picture, 1.0, 1.0, 6.0, 2.0, 0 * more)
    assert np.array_equal(none, picture_with_bloom(picture, 1.0, 1.0, 6.0, 2.0))


def test_growth_is_a_knob_and_needs_depth():
    picture = with_light(80, 120, 3e4)
    off = looked(picture, depth_plane(1200.0), bloom_gain=0.5, bloom_growth=0.0)
    on = looked(picture, depth_plane(1200.0), bloom_gain=0.5)
    assert np.abs(on - off).max() > 0.1
    flat = [looked(picture, bloom_gain=0.5, bloom_growth=g) for g in (0.0, 1.0)]
    assert np.array_equal(*flat)


def test_a_light_keeps_its_blur_where_its_disc_lies_over_other_distances():
    colour = np.full((160, 240, 3), 0.1, np.float32)
    colour[79:82, 119:122] = 500
    radius = np.full((160, 240), 0.0, np.float32)
    radius[79:82, 119:122] = 12.0
    found = blur_of_light([SharpLayer(colour, radius)], 1.0)
    y, x = (np.indices(found.shape) + 0.5) * 4
    disc = np.hypot(x - 120.5, y - 80.5) < 12
    assert found[disc] == pytest.approx(12.0, rel=0.25)


def test_lights_of_two_layers_share_a_place_by_their_light():
    colour, radius = with_light(80, 120, 100.0, 0.0), np.full((160, 240), 4.0)
    near = SharpLayer(colour, radius.astype(np.float32))
    far = SharpLayer(3 * colour, np.zeros((160, 240), np.float32))
    alone = blur_of_light([near], 0.0)[20, 30]
    assert alone == pytest.approx(4.0, rel=0.01)
    assert 0 < blur_of_light([near, far], 0.0)[20, 30] < 0.5 * alone
    unknown = blur_of_light([SharpLayer(colour, None)], 0.0)
    assert unknown.shape == (40, 60)
    assert not unknown.any()


def test_bright_sky_at_the_border_stays_as_bright():
    sky = grey(5.0)
    assert looked(sky, bloom_gain=0.7) == pytest.approx(sky, rel=1e-5)


FILTERS = pytest.mark.parametrize("name", ["pro_mist", "diffusion"])


@FILTERS
def test_the_share_that_is_left_is_the_core(name):
    picture = with_light(80, 120, 1000.0)
    made = looked(picture, **{f"{name}_gain": 0.3, f"{name}_size_percent": 6.0})
    assert made.sum(dtype=float) == pytest.approx(picture.sum(), rel=1e-5)
    assert made[80, 120, 1] - made[80, 121, 1] == pytest.approx(700, abs=0.5)
    halo = made[..., 1] - 0.7 * picture[..., 1]
    assert within(halo, (120.5, 80.5), 0.06 * WIDTH) == pytest.approx(0.5, abs=0.04)


@FILTERS
def test_a_filter_is_linear_in_all_light(name):
    knobs = {f"{name}_gain": 0.4}
    one, two = noise(1), noise(2)
    both = looked(one + 2 * two, **knobs)
    assert both == pytest.approx(looked(one, **knobs) + 2 * looked(two, **knobs), 1e-4)


@FILTERS
def test_an_even_picture_stays_as_it_is(name):
    assert looked(grey(), **{f"{name}_gain": 0.8}) == pytest.approx(grey(), rel=1e-5)


def test_mist_lifts_black_far_from_the_light_and_diffusion_does_not():
    picture = with_light(80, 120, 1000.0)
    mist = looked(picture, pro_mist_gain=0.25)[40, 40, 1]
    soft = looked(picture, diffusion_gain=0.25)[40, 40, 1]
    assert mist > 1e-4
    assert soft < 1e-6


def test_diffusion_softens_detail_by_its_share():
    picture = noise()
    made = looked(picture, diffusion_gain=0.4, diffusion_size_percent=2.0)
    # What varies from pixel to pixel is nearly all lost in the halo.
    contrast = np.diff(made, axis=1).std() / np.diff(picture, axis=1).std()
    assert contrast == pytest.approx(0.6, abs=0.01)
    assert made.mean() == pytest.approx(picture.mean(), rel=1e-5)

"""Pro-mist and diffusion: a known share of all light, scattered and never lost."""

import numpy as np
import pytest
from look_makers import WIDTH, grey, looked, noise, with_light, within

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

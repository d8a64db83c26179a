"""Light above a threshold: soft, in its own colour, the same at any exposure."""

import numpy as np
import pytest

from lensfit.rendering.look.light import (
    all_light,
    brightness_above,
    light_above,
    picture_with_halo,
)


def greys(values):
    return np.repeat(np.asarray(values, np.float32)[None, :, None], 3, 2)


def test_nothing_below_the_knee_and_all_of_the_excess_above_it():
    values = np.linspace(0, 8, 801)
    above = light_above(greys(values), 2.0)[0, :, 0]
    assert not above[values <= 1].any()
    assert above[values >= 3] == pytest.approx(values[values >= 3] - 2, rel=1e-5)
    # Smooth: no step in value, none in slope.
    assert np.abs(np.diff(above, 2)).max() < 1e-3
    assert (np.diff(above) >= -1e-6).all()


def test_exposure_and_threshold_scale_together():
    colour = np.random.default_rng(0).uniform(0, 9, (8, 8, 3)).astype(np.float32)
    assert light_above(4 * colour, 8.0) == pytest.approx(
        4 * light_above(colour, 2.0), rel=1e-5
    )


def test_the_colour_stays():
    above = light_above(np.array([[[8.0, 2.0, 4.0]]], np.float32), 1.0)[0, 0]
    assert above == pytest.approx([7.0, 1.75, 3.5])


def test_a_threshold_of_nothing_is_all_light():
    colour = np.random.default_rng(0).normal(size=(5, 6, 3)).astype(np.float32)
    assert np.array_equal(light_above(colour, 0.0), np.maximum(colour, 0))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_gives_no_light(bad):
    colour = np.full((3, 3, 3), 5.0, np.float32)
    colour[1, 1, 2] = bad
    for light in (all_light(colour), light_above(colour, 1.0)):
        assert not light[1, 1].any()
        assert (light[0] > 0).all()
    assert brightness_above(colour, 1.0)[1, 1] == 0


def test_negative_light_is_none_and_stays_in_the_picture():
    colour = np.array([[[-0.5, 4.0, 0.0]]], np.float32)
    light = light_above(colour, 1.0)
    assert light[0, 0].tolist() == [0.0, 3.0, 0.0]
    assert picture_with_halo(colour, light, 0 * light, 1.0)[0, 0].tolist() == [
        -0.5,
        1.0,
        0.0,
    ]


def test_one_channel_is_as_good_as_three():
    values = np.linspace(0, 8, 20)
    one = light_above(greys(values)[..., :1], 2.0)
    assert np.array_equal(one[..., 0], light_above(greys(values), 2.0)[..., 1])
    assert brightness_above(greys(values), 2.0) == pytest.approx(one[..., 0], rel=1e-5)

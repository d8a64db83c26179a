"""White balance: published whites, neutral at 6500 K, greys keep their light."""

import numpy as np
import pytest
from look_makers import grey, looked, noise

from lensfit.errors import LensfitError
from lensfit.rendering.look.white_balance import (
    REC709,
    balance_matrix,
    balanced_picture,
    daylight_xy,
    planckian_xy,
    white_xyz,
    xyz_from_rgb,
)

ACESCG = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)


def xy_of(xyz):
    return xyz[:2] / xyz.sum()


@pytest.mark.parametrize(
    ("kelvin", "xy"),
    [  # D50, D55, D65, D75 of CIE 15, at their nominal temperatures times 1.4388/1.4380
        (5002.8, (0.34567, 0.35850)),
        (5503.1, (0.33242, 0.34743)),
        (6503.6, (0.31271, 0.32902)),
        (7504.2, (0.29902, 0.31485)),
    ],
)
def test_daylight_is_that_of_the_cie(kelvin, xy):
    assert daylight_xy(kelvin) == pytest.approx(xy, abs=1.5e-4)
    assert xy_of(white_xyz(kelvin)) == pytest.approx(xy, abs=1.5e-4)


def test_incandescent_light_is_illuminant_a():
    assert planckian_xy(2855.5) == pytest.approx((0.44758, 0.40745), abs=6e-4)
    assert xy_of(white_xyz(2855.5)) == pytest.approx((0.44758, 0.40745), abs=6e-4)


def test_the_two_loci_meet_without_a_step():
    kelvin = np.arange(3800.0, 5200.0, 10)
    xy = np.array([xy_of(white_xyz(k)) for k in kelvin])
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    assert steps.max() < 1.8 * np.median(steps)


def test_primaries_are_those_of_rec_709():
    exact = [
        [0.4124, 0.3576, 0.1805],
        [0.2126, 0.7152, 0.0722],
        [0.0193, 0.1192, 0.9505],
    ]
    assert xyz_from_rgb(REC709) == pytest.approx(np.array(exact), abs=2e-4)


@pytest.mark.parametrize("primaries", [REC709, ACESCG])
@pytest.mark.parametrize(("kelvin", "tint"), [(3200, 0), (5600, 10), (12000, -40)])
def test_a_grey_keeps_its_luminance(primaries, kelvin, tint):
    matrix = balance_matrix(kelvin, tint, primaries)
    luminance = xyz_from_rgb(primaries)[1]
    assert luminance @ matrix @ np.ones(3) == pytest.approx(1, rel=1e-12)


def test_neutral_is_the_identity_and_the_way_there_is_smooth():
    assert balance_matrix(6500, 0) == pytest.approx(np.eye(3), abs=1e-12)
    assert balance_matrix(6510, 0.1) == pytest.approx(np.eye(3), abs=2e-3)


def test_light_of_the_set_white_becomes_white():
    # Light of 3200 K, as a plate whose white is 6500 K shows it, turns grey.
    white = np.concatenate([REC709[:6], xy_of(white_xyz(6500))])
    matrix = balance_matrix(3200, 15, tuple(white))
    seen = np.linalg.solve(xyz_from_rgb(tuple(white)), white_xyz(3200, 15))
    balanced_white = matrix @ seen
    assert balanced_white / balanced_white[1] == pytest.approx(np.ones(3), abs=1e-9)


def test_warmer_and_more_magenta():
    red, green, blue = looked(grey(), white_balance_kelvin=9000.0)[0, 0]
    assert red > green > blue
    red, green, blue = looked(grey(), white_balance_kelvin=4300.0)[0, 0]
    assert red < green < blue
    red, green, blue = looked(grey(), white_balance_tint=40.0)[0, 0]
    assert green < red < 1.2 * blue


def test_known_gain_of_tungsten():
    # Independently: D65-based Bradford gain between the two whites, in XYZ.
    bradford = np.array(
        [
            [0.8951, 0.2664, -0.1614],
            [-0.7502, 1.7135, 0.0367],
            [0.0389, -0.0685, 1.0296],
        ]
    )
    new, old = (
        np.array([x / y, 1, (1 - x - y) / y])
        for x, y in (daylight_xy(6500.0), planckian_xy(3200.0))
    )
    cones = bradford @ (xyz_from_rgb(REC709) @ np.ones(3))
    shown = np.linalg.inv(bradford) @ (cones * (bradford @ new) / (bradford @ old))
    rgb = np.linalg.inv(xyz_from_rgb(REC709)) @ (shown / shown[1])
    made = looked(grey(1.0), white_balance_kelvin=3200.0)[0, 0]
    assert made == pytest.approx(rgb, rel=1e-5)


def test_what_is_no_number_keeps_its_bits_and_negatives_stay_linear():
    colour = noise()[:4, :4]
    colour[0, 0, 1], colour[1, 1, 2], colour[2, 2, 0] = np.nan, np.inf, -3
    made = balanced_picture(colour, balance_matrix(4000, 0))
    for place in ((0, 0), (1, 1)):
        assert made[place].tobytes() == colour[place].tobytes()
    assert made[2, 2] == pytest.approx(balance_matrix(4000, 0) @ colour[2, 2], rel=1e-5)


@pytest.mark.parametrize(
    "wrong", [(0.3,) * 8, (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.0)]
)
def test_primaries_that_span_nothing_are_refused(wrong):
    with pytest.raises(LensfitError, match="span no colours"):
        xyz_from_rgb(wrong)

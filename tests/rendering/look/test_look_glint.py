"""Glints: streaks of known number, length and angle, with red the longest."""

import numpy as np
import pytest
from look_makers import HEIGHT, WIDTH, grey, looked, with_light

from lensfit.optics.spectrum import CENTRES_NM, REFERENCE_NM
from lensfit.rendering.look.glint import Star, picture_with_glints, star_kernel

ROW, COLUMN = 80, 120


def star(streaks=6, length=30.0, rotation=0.0, dispersion=1.0):
    return Star(streaks, length, rotation, 1.2, dispersion)


def kernel(*arguments, length=30.0, **options):
    return star_kernel(star(*arguments, length=length, **options), length, 1.2)


def ring(plane, radius, count=720):
    """Values about the middle, by azimuth from x towards y."""
    middle = plane.shape[0] // 2
    azimuth = 2 * np.pi * np.arange(count) / count
    rows = np.rint(middle + radius * np.sin(azimuth)).astype(int)
    columns = np.rint(middle + radius * np.cos(azimuth)).astype(int)
    return plane[rows, columns]


@pytest.mark.parametrize("streaks", [1, 2, 5, 6, 13])
def test_a_kernel_sums_to_one_and_has_as_many_streaks(streaks):
    made = kernel(streaks, length=60.0)
    assert made.sum() == pytest.approx(1, abs=1e-6)
    around = ring(made, 30)
    lit = around > around.max() / 4
    rises = np.diff(lit.astype(int), append=int(lit[0])) == 1
    assert np.count_nonzero(rises) == streaks


def test_the_first_streak_lies_at_the_rotation():
    for rotation, (row, column) in {0: (0, 1), 90: (1, 0), 180: (0, -1)}.items():
        made = kernel(1, rotation=float(rotation))
        y, x = np.indices(made.shape) - made.shape[0] // 2
        mean = np.array([(made * y).sum(), (made * x).sum()])
        assert mean / np.linalg.norm(mean) == pytest.approx([row, column], abs=1e-6)


def test_turning_by_a_streak_changes_nothing_and_by_a_quarter_turns_the_picture():
    assert kernel(6, rotation=60.0) == pytest.approx(kernel(6), abs=1e-7)
    assert kernel(3, rotation=90.0) == pytest.approx(np.rot90(kernel(3), -1), abs=1e-7)
    assert kernel(5, rotation=36.0) == pytest.approx(np.rot90(kernel(5), 2), abs=1e-7)


def test_light_along_a_streak_falls_as_said():
    length = 100.0
    profile = kernel(1, length=length).sum(0)
    middle = len(profile) // 2
    t = np.arange(10, 90)
    exact = np.exp(-5 * t / length) - np.exp(-5)
    made = profile[middle + t]
    assert made / made.sum() == pytest.approx(exact / exact.sum(), rel=0.02)
    assert not profile[middle + int(length) + 7 :].any()


def test_lengths_follow_the_wavelength():
    ratio = np.array(CENTRES_NM) / REFERENCE_NM
    assert star().lengths_px(3) == pytest.approx(30 * ratio)
    assert star(dispersion=0.0).lengths_px(3) == [30.0]
    assert star().lengths_px(1) == [30.0]
    assert min(star(dispersion=5.0).lengths_px(3)) > 0


def test_red_reaches_farther_than_blue_and_each_keeps_its_light():
    picture = with_light(ROW, COLUMN, 1000.0)
    made = looked(picture, glint_gain=0.5, glint_streaks=2, glint_length_percent=30.0)
    assert made.sum((0, 1)) == pytest.approx(picture.sum((0, 1)), rel=1e-4)
    red, green, blue = made[ROW - 4 : ROW + 5, COLUMN + 66].sum(0)
    assert red > 1.2 * green > 1.4 * blue > 0


def test_the_share_is_of_the_light_above_the_threshold():
    picture = with_light(ROW, COLUMN, 104.0)
    made = looked(picture, glint_gain=0.25, glint_threshold=4.0)
    streaks = np.maximum(made, 0)[..., 1].astype(float)
    streaks[ROW, COLUMN] -= 104 - 25
    assert streaks.sum() == pytest.approx(25, rel=1e-4)
    dim = grey(1.0)
    assert looked(dim, glint_gain=1.0).tobytes() == dim.tobytes()


def test_exposure_and_threshold_scale_together():
    picture = with_light(ROW, COLUMN, 50.0, 0.3)
    one = looked(picture, glint_gain=0.3, glint_threshold=2.0)
    four = looked(4 * picture, glint_gain=0.3, glint_threshold=8.0)
    assert four == pytest.approx(4 * one, rel=1e-4, abs=1e-6)


def test_streaks_leave_over_the_border_and_do_not_come_back():
    made = looked(with_light(2, 2, 1000.0), glint_gain=1.0, glint_streaks=1)
    assert made.sum() == pytest.approx(3 * 1000, rel=1e-3)
    knobs = {"glint_gain": 1.0, "glint_streaks": 1, "glint_rotation_deg": 180.0}
    away = looked(with_light(2, 2, 1000.0), **knobs)
    assert away.sum() < 0.7 * made.sum()
    assert away[:, 40:].max() == 0


def test_a_larger_plate_is_computed_smaller_and_looks_the_same():
    large = np.zeros((16 * HEIGHT, 16 * WIDTH, 1), np.float32)
    large[16 * ROW : 16 * ROW + 64, 16 * COLUMN : 16 * COLUMN + 64] = 100
    one = Star(4, 0.1 * 16 * WIDTH, 17.0, 6e-4 * 16 * WIDTH, 0.0)
    small, whole = (
        picture_with_glints(large, 0.0, 1.0, one, least) for least in (2.0, 9.0)
    )
    assert np.linalg.norm(small - whole) < 0.01 * np.linalg.norm(whole)

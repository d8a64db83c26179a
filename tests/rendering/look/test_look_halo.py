"""Halos on small pictures are those of the whole picture; no light is made or lost."""

import numpy as np
import pytest

from lensfit.rendering.look.glare import (
    BLOOM,
    DIFFUSION,
    PRO_MIST,
    Halo,
    light_with_halo,
    octave_shares,
)
from lensfit.rendering.look.light import (
    doubled_picture,
    gaussian,
    halved_picture,
    least_sigma_px,
    left_of,
    level_of,
    padded_picture,
    picture_at_level,
)

SIDE = 256
HALOS = pytest.mark.parametrize("halo", [BLOOM, DIFFUSION, PRO_MIST])


def point(row, column, side=SIDE):
    picture = np.zeros((side, side, 1), np.float32)
    picture[row, column] = 1
    return picture


def exact_gaussian(row, column, sigma, side=SIDE):
    t = np.arange(side)
    tall, wide = (
        np.exp(-0.5 * ((t - middle) / sigma) ** 2) for middle in (row, column)
    )
    both = np.outer(tall, wide)
    return both / both.sum()


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("place", [(128, 128), (125, 130), (131, 122)])
def test_down_and_up_keeps_sum_and_place_and_widens_by_what_it_says(times, place):
    made = doubled_picture(halved_picture(point(*place), times), times)[..., 0].astype(
        float
    )
    t = np.arange(SIDE)
    assert made.sum() == pytest.approx(1, abs=1e-6)
    for axis, middle in zip((1, 0), place, strict=True):
        profile = made.sum(axis)
        assert profile @ t == pytest.approx(middle, abs=1e-4)
        square = profile @ (t - middle) ** 2
        assert square == pytest.approx((4**times - 1) / 2, rel=1e-4)


@pytest.mark.parametrize("sigma", [6.0, 9.7, 16.0])
@pytest.mark.parametrize("level", [1, 2])
def test_what_is_left_makes_the_gaussian(sigma, level):
    rest = left_of(sigma, level)
    worst = 0.0
    for row, column in [(128, 128), (129, 131), (126, 127)]:
        small = gaussian(halved_picture(point(row, column), level), rest)
        made = doubled_picture(small, level)[..., 0]
        exact = exact_gaussian(row, column, sigma)
        worst = max(worst, np.linalg.norm(made - exact) / np.linalg.norm(exact))
    assert worst < 0.025 * rest**-2.5


def test_a_tighter_tolerance_halves_less_often():
    least = [least_sigma_px(tolerance) for tolerance in (1e-2, 1e-3, 1e-5)]
    levels = [level_of(12.0, least_px, (SIDE, SIDE)) for least_px in least]
    assert levels == sorted(levels, reverse=True)
    assert levels[0] > levels[-1]
    assert level_of(1e4, 1.0, (3, 3)) == 0


@HALOS
def test_half_of_the_light_lies_within_the_half_light_radius(halo):
    assert halo.within(halo.half_light_radius) == pytest.approx(0.5, abs=1e-9)
    half_px = 8.0
    made = light_with_halo(point(128, 128), halo, half_px, 2.0)[..., 0]
    y, x = np.indices(made.shape) - 128
    assert made[np.hypot(x, y) <= half_px].sum() == pytest.approx(0.5, abs=0.02)


def test_shares_fall_off_as_said():
    # Equal shares fall as 1/r^2, shares that halve as 1/r^3, well inside.
    for factor, power in ((1.0, 2), (0.5, 3)):
        halo = Halo(tuple(factor**m for m in range(14)))
        r = np.array([8.0, 16.0, 32.0, 64.0])
        value = sum(
            w * np.exp(-0.5 * (r / 2**m) ** 2) / 4**m for m, w in enumerate(halo.shares)
        )
        assert np.diff(np.log2(value)) == pytest.approx(-power, abs=0.06)


@pytest.mark.slow
@HALOS
@pytest.mark.parametrize("half_px", [0.02, 0.7, 5.0, 60.0])
def test_light_is_kept_at_the_border_too_and_a_constant_stays(halo, half_px):
    picture = point(0, 3) + 2 * point(200, 255)
    made = light_with_halo(picture, halo, half_px, 2.0)
    assert made.min() >= 0
    assert made.sum(dtype=float) == pytest.approx(3, rel=1e-5)
    for shape, error in (((96, 128, 3), 2e-5), ((97, 131, 3), 4e-4)):
        constant = np.full(shape, 0.7, np.float32)
        made = light_with_halo(constant, halo, half_px, 2.0)
        assert made == pytest.approx(constant, rel=error)


def test_a_halo_has_no_preferred_side():
    picture = np.random.default_rng(0).random((64, 96, 3), np.float32)
    made = light_with_halo(picture, BLOOM, 4.0, 1.0)
    for flip in (np.flipud, np.fliplr):
        flipped = light_with_halo(np.ascontiguousarray(flip(picture)), BLOOM, 4.0, 1.0)
        assert flipped == pytest.approx(flip(made), abs=1e-6)


def test_a_point_of_no_size_stays_where_it_is():
    assert np.array_equal(gaussian(point(9, 9, 20), 0.1), point(9, 9, 20))


@pytest.mark.parametrize("shape", [(1, 1), (2, 7), (5, 4)])
def test_tiny_pictures_are_pictures(shape):
    picture = np.random.default_rng(1).random((*shape, 3), np.float32)
    for half_px in (0.3, 40.0):
        made = light_with_halo(picture, PRO_MIST, half_px, 1.0)
        assert made.shape == picture.shape
        assert np.isfinite(made).all()
        assert made.sum() == pytest.approx(picture.sum(), rel=1e-3)


def test_sizes_are_dealt_so_that_their_mean_square_stays():
    square = np.linspace(1, 64, 500, dtype=np.float32)[:, None, None]
    shares = np.stack([share[:, 0, 0] for share in octave_shares(square, 4)])
    assert shares.min() >= 0
    assert shares.sum(0) == pytest.approx(1, abs=1e-6)
    assert 4.0 ** np.arange(4) @ shares == pytest.approx(square[:, 0, 0], rel=1e-5)
    assert ((shares > 0).sum(0) <= 2).all()


def test_another_level_covers_the_same_pixels():
    picture = np.random.default_rng(2).random((37, 50, 1), np.float32)
    small = halved_picture(padded_picture(picture, 2), 2)
    assert (
        picture_at_level(small, 2, 4).shape
        == halved_picture(padded_picture(picture, 4), 4).shape
    )
    assert picture_at_level(small, 2, 2) is small
    finer = picture_at_level(small, 2, 1)
    assert all(a >= b / 2 for a, b in zip(finer.shape[:2], picture.shape, strict=False))

"""Polynomials over the box of the rays: the same images as the waves themselves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit.fitting.wavefront.polynomials import DEGREES, polynomials_over
from lensfit.fitting.wavefront.waves import Waves, multiples
from lensfit.psf.spot import Spot, image_of

CELLS, CELL_MM, RAYS = 24, 0.01, 96
SLOW = 28
"""Waves that polynomials follow over each of the boxes here but the widest."""
SIZE_MM = CELLS * CELL_MM
VARIANCE_MM2 = jnp.full(2, (0.3 * CELL_MM) ** 2)


def waves_of(rng) -> Waves:
    """Behind any transfer function that falls off."""
    n = SLOW + 1
    down, right = np.arange(-SLOW, n)[:, None], np.arange(n)
    fall = 1 / (1 + down**2 + right**2)
    pattern = fall * np.exp(1j * rng.uniform(0, 2 * np.pi, fall.shape))
    return Waves(
        corner_mm=jnp.zeros(2),
        cell_mm=jnp.full(2, CELL_MM),
        cells=CELLS,
        transfer=jnp.asarray(pattern),
    )


def spot_of(rng, reach_cells: float) -> Spot:
    """Rays of one width, which fill an oval off the middle of the patch."""
    reach, turn = np.sqrt(rng.random(RAYS)), 2 * np.pi * rng.random(RAYS)
    oval = reach[:, None] * np.stack([np.cos(turn), 0.6 * np.sin(turn)], -1)
    landing_mm = 0.45 * SIZE_MM + reach_cells * CELL_MM * oval
    own_mm2 = np.pi * (reach_cells * CELL_MM) ** 2 / RAYS
    weight = rng.uniform(0.5, 1.5, RAYS) / RAYS
    return Spot(jnp.asarray(landing_mm), jnp.asarray(weight), jnp.full(RAYS, own_mm2))


@pytest.mark.parametrize("reach_cells", [0.0, 0.3, 2.0, 4.5])
def test_images_are_those_of_the_waves(reach_cells):
    rng = np.random.default_rng(1)
    waves, spot = waves_of(rng), spot_of(rng, reach_cells)
    short = polynomials_over(spot, waves, VARIANCE_MM2)
    assert short.size == DEGREES < waves.size // 2
    truth, found = (
        basis.cell_light(image_of(spot, basis.profile(spot, VARIANCE_MM2)))
        for basis in (waves, short)
    )
    assert np.linalg.norm(found - truth) < 2e-4 * np.linalg.norm(truth)


@pytest.mark.parametrize("reach_cells", [0.3, 2.0, 4.5])
def test_moving_a_ray_changes_both_alike(reach_cells):
    """Derivatives that `profile` states, where each ray moves by its own amount."""
    rng = np.random.default_rng(2)
    waves, spot = waves_of(rng), spot_of(rng, reach_cells)
    short = polynomials_over(spot, waves, VARIANCE_MM2)
    moved_mm = jnp.asarray(rng.normal(0, 1, (RAYS, 2)))

    def change(basis):
        of = basis.profile(spot, VARIANCE_MM2)
        weight = spot.weight[None]
        across = (of.rows * weight * moved_mm[None, :, 0]) @ of.columns_moved.T
        down = (of.rows_moved * weight * moved_mm[None, :, 1]) @ of.columns.T
        return np.asarray(basis.cell_light(across + down))

    truth, found = change(waves), change(short)
    assert np.linalg.norm(found - truth) < 2e-3 * np.linalg.norm(truth)


def test_a_wide_blur_keeps_its_slow_waves():
    """What polynomials cannot follow is left out, and nothing is put in its place."""
    rng = np.random.default_rng(3)
    waves, spot = waves_of(rng), spot_of(rng, 11.0)
    short = polynomials_over(spot, waves, VARIANCE_MM2)
    kept = np.any(np.asarray(short.right) != 0, -1)
    assert 0 < kept.sum() < kept.size
    truth = np.asarray(waves.profile(spot, VARIANCE_MM2).columns)
    of = short.profile(spot, VARIANCE_MM2)
    found = np.asarray(short.right @ of.columns)
    np.testing.assert_allclose(found[kept], truth[kept], atol=0.02)
    np.testing.assert_array_equal(found[~kept], 0.0)


def test_the_transpose_is_one():
    rng = np.random.default_rng(4)
    waves, spot = waves_of(rng), spot_of(rng, 2.0)
    for basis in (waves, polynomials_over(spot, waves, VARIANCE_MM2)):
        drawn = jnp.asarray(rng.normal(size=(basis.size, basis.size)))
        light = jnp.asarray(rng.normal(size=(CELLS, CELLS)))
        forward = jnp.sum(basis.cell_light(drawn) * light)
        back = jnp.sum(drawn * basis.cell_light_transpose(light))
        np.testing.assert_allclose(forward, back, rtol=1e-10)


def test_light_is_the_real_part_of_complex_waves():
    """The sum itself, wave by wave, in numpy."""
    rng = np.random.default_rng(5)
    waves = waves_of(rng)
    angle = 0.7
    even, odd = multiples(jnp.asarray([angle]), SLOW + 1)
    one = jnp.concatenate([even, odd])
    found = waves.cell_light(one @ one.T)
    k = np.arange(-SLOW, SLOW + 1) * 2 * np.pi / (2 * CELLS)
    middle = np.arange(CELLS) + 0.5 - CELLS / 2
    at_cells = np.exp(1j * middle[:, None] * k)
    ray = np.exp(-1j * angle * np.arange(-SLOW, SLOW + 1))
    right = slice(SLOW, None)
    amplitudes = np.asarray(waves.transfer) * ray[:, None] * ray[right]
    truth = np.real(at_cells @ amplitudes @ at_cells[:, right].T)
    np.testing.assert_allclose(found, truth, atol=1e-10)


def test_the_box_of_one_point_is_no_division_by_zero():
    spot = Spot(jnp.full((RAYS, 2), 0.1), jnp.ones(RAYS) / RAYS, jnp.zeros(RAYS))
    waves = waves_of(np.random.default_rng(6))
    drawn = jax.jit(polynomials_over)(spot, waves, VARIANCE_MM2)
    of = drawn.profile(spot, VARIANCE_MM2)
    assert all(np.isfinite(part).all() for part in of)

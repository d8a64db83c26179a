"""Broad dots: discs with sharp rims, drawn beyond the patch and convolved."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import GREY, LAYOUT, SCALE, Seidel, cell_counts, dots_at
from ray_moves import only_group, rays_alone

from lensfit.fitting.wavefront.dot_arrays import DetectionAperture, undrawn
from lensfit.fitting.wavefront.patch import equations_of
from lensfit.fitting.wavefront.rays import spot_and_pullback
from lensfit.fitting.wavefront.waves import (
    WAVES,
    basis_of,
    transfers_of,
    waves_after_smoothing,
)
from lensfit.psf.spot import Spot, image_of

PIXEL_MM, CELLS, RAYS = 0.01, 24, 1536
PLACE_MM = np.array([0.1232, 0.1171])
NOBODY = np.full((8, 2), np.nan)
VARIANCE_MM2 = jnp.full(2, 1e-6)


def dot_of(disc_mm, neighbour_offsets_mm=NOBODY, size_width=1e-4):
    """A dot on axis and its transfer, as a pass has them."""
    cell_mm = np.full((1, 2), PIXEL_MM)
    one = np.ones(1)
    aperture = DetectionAperture(5 * np.eye(2)[None], 1.3 * one, 0.3 * one, 0 * one)
    broad = undrawn(1)._replace(
        disc_mm=disc_mm[None],
        neighbour_offsets_mm=neighbour_offsets_mm[None],
        size_width=np.full(1, size_width),
        aperture=aperture,
    )
    transfer = transfers_of(broad, cell_mm, CELLS, [None] * len(cell_mm))
    dots = dots_at(np.zeros((1, 2)), 0, 0, PIXEL_MM)._replace(broad=broad)
    return jax.tree.map(lambda a: jnp.asarray(a[0]), (dots, transfer))


def _numbers(defocus_mm):
    """Parameters of a lens without aberrations."""
    first = LAYOUT.blocks["defocus"].start
    return jnp.asarray(Seidel(defocus_mm=()).parameters()).at[first].set(defocus_mm)


def image(defocus_mm, disc_mm, waves=WAVES, neighbour_offsets_mm=NOBODY):
    dot, transfer = dot_of(disc_mm, neighbour_offsets_mm)
    return np.asarray(_image(defocus_mm, dot, transfer, VARIANCE_MM2, waves))


@partial(jax.jit, static_argnames="waves")
def _image(defocus_mm, dot, transfer, variance_mm2, waves):
    spot, _ = spot_and_pullback(_numbers(defocus_mm), dot, GREY, LAYOUT, SCALE, RAYS)
    basis = basis_of(-jnp.asarray(PLACE_MM), dot.cell_mm, CELLS, transfer, waves)
    profile = basis.profile(spot, variance_mm2)
    return basis.cell_light(image_of(spot, profile))


@lru_cache(maxsize=1)
def _landed_mm(defocus_mm, rays):
    """Where rays of a point land, and a place of the unit disc for each."""
    rng = np.random.default_rng(3)
    lens = Seidel(defocus_mm=(defocus_mm,))
    u = lens.opening(np.zeros(2), 1.0, rays, rng)
    reach, turn = np.sqrt(rng.random(rays)), 2 * np.pi * rng.random(rays)
    disc = reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
    landed = lens.landing_mm(u, np.zeros(2), 0) + PLACE_MM
    return landed + rng.normal(0, 1e-3, landed.shape), disc


def counted(defocus_mm, disc_mm, at_mm=(0.0, 0.0), rays=4_000_000):
    """Light of very many rays, in numpy alone."""
    landed, disc = _landed_mm(defocus_mm, rays)
    x = landed + disc @ disc_mm.T + at_mm
    return cell_counts(x, np.zeros(2), PIXEL_MM, CELLS) / rays


@pytest.fixture(autouse=True, scope="module")
def _rays_let_go():
    """They are a hundred megabytes."""
    yield
    _landed_mm.cache_clear()


@pytest.mark.slow
@pytest.mark.parametrize("radius_cells", [2.0, 4.0, 8.0])
@pytest.mark.parametrize("defocus_mm", [0.0, 0.1, 0.5])
def test_a_disc_is_as_very_many_rays_have_it(defocus_mm, radius_cells):
    oval = PIXEL_MM * radius_cells * np.array([[1.0, 0.1], [-0.05, 0.8]])
    truth, found = counted(defocus_mm, oval), image(defocus_mm, oval)
    # What very many rays scatter by.
    scatter = np.sqrt(truth.sum() / 4e6)
    assert np.linalg.norm(found - truth) < 0.03 * np.linalg.norm(truth) + scatter


def test_light_is_kept_and_none_comes_from_the_other_edge():
    wide = image(0.5, 8 * PIXEL_MM * np.eye(2))
    assert wide.sum() <= 1 + 1e-5
    assert np.abs(image(0.0, 3 * PIXEL_MM * np.eye(2))[:4]).max() < 2e-4


def test_dots_beside_reach_into_the_picture():
    disc = 5 * PIXEL_MM * np.eye(2)
    beside = PIXEL_MM * np.array([[16.0, 0.5], [-0.5, 16.0], [16.0, 16.0]])
    truth = counted(0.5, disc) + sum(counted(0.5, disc, at) for at in beside)
    padded = np.concatenate([beside, NOBODY[3:]])
    found = image(0.5, disc, neighbour_offsets_mm=padded)
    assert np.linalg.norm(found - truth) < 0.02 * np.linalg.norm(truth)
    alone = image(0.5, disc)
    assert np.linalg.norm(alone - truth) > 0.1 * np.linalg.norm(truth)


def test_the_gradient_is_that_of_the_sum_of_squares():
    """By defocus, against differences of what the patch itself minimises."""
    disc = 4 * PIXEL_MM * np.eye(2)
    # On both sides: where dots have yet to be moved, their shift is left out.
    beside = np.concatenate([14 * PIXEL_MM * np.eye(2)[:1] * s for s in (1, -1)])
    beside = np.concatenate([beside, NOBODY[2:]])
    light = jnp.asarray(3 * image(0.2, disc, neighbour_offsets_mm=beside) + 0.1)
    dot, transfer = dot_of(disc, beside)

    @jax.jit
    def of(numbers, weight, cell_mm2):
        seen = (dot, GREY, LAYOUT, SCALE)
        spot, pullback = spot_and_pullback(numbers, *seen, RAYS)
        # Derivatives by defocus take light and widths of the rays as they are.
        held = Spot(spot.landing_mm, weight, cell_mm2)
        patch = equations_of(
            held,
            only_group(rays_alone(numbers, *seen, 96)),
            light,
            jnp.ones_like(light),
            -jnp.asarray(PLACE_MM),
            dot.cell_mm,
            VARIANCE_MM2,
            transfer,
        )
        return patch.chi_squared, pullback(patch.spot_gradient), spot

    numbers = _numbers(0.3)
    spot = of(numbers, jnp.ones(RAYS), jnp.ones(RAYS))[2]
    rays = spot.weight, spot.cell_mm2
    which, step = LAYOUT.blocks["defocus"].start, 1e-3
    ends = [of(numbers.at[which].add(s), *rays)[0] for s in (-step, step)]
    slope = 2 * of(numbers, *rays)[1][which]
    np.testing.assert_allclose(slope, (ends[1] - ends[0]) / (2 * step), rtol=2e-3)


def smoothed_image(waves, cells, defocus_mm, disc_mm, neighbour_offsets_mm):
    """As the first stages of a fit smooth it."""
    dot, transfer = dot_of(disc_mm, neighbour_offsets_mm)
    variance_mm2 = jnp.full(2, (cells * PIXEL_MM) ** 2)
    return np.asarray(_image(defocus_mm, dot, transfer, variance_mm2, waves))


@pytest.mark.slow
@pytest.mark.parametrize("radius_cells", [1.0, 4.0])
@pytest.mark.parametrize("defocus_mm", [0.0, 0.3])
@pytest.mark.parametrize("cells", [0.8, 1.5, 3.0])
def test_few_waves_do_for_smoothed_images(cells, radius_cells, defocus_mm):
    disc = radius_cells * PIXEL_MM * np.eye(2)
    beside = np.concatenate([[[13 * PIXEL_MM, -2 * PIXEL_MM]], NOBODY[1:]])
    few = waves_after_smoothing(cells, CELLS)
    assert few < WAVES
    all_of_them, left = (
        smoothed_image(n, cells, defocus_mm, disc, beside) for n in (WAVES, few)
    )
    error = np.linalg.norm(left - all_of_them)
    assert error < 2e-3 * np.linalg.norm(all_of_them)


def test_what_is_not_smoothed_has_all_waves():
    assert waves_after_smoothing(0.0, CELLS) == WAVES


@pytest.mark.parametrize("waves", [WAVES, 9])
def test_what_is_traced_back_is_the_transpose_of_what_is_seen(waves):
    """Of a linear map: <pull, seen(drawn)> = <traced_back(pull), drawn>."""
    disc = 3 * PIXEL_MM * np.eye(2)
    dot, transfer = dot_of(disc, np.concatenate([[[0.11, 0.02]], NOBODY[1:]]))
    basis = basis_of(-jnp.asarray(PLACE_MM), dot.cell_mm, CELLS, transfer, waves)
    rng = np.random.default_rng(7)
    drawn = jnp.asarray(rng.normal(size=(basis.size,) * 2))
    pull = jnp.asarray(rng.normal(size=(CELLS, CELLS)))
    forth = jnp.sum(pull * basis.cell_light(drawn))
    back = jnp.sum(basis.cell_light_transpose(pull) * drawn)
    np.testing.assert_allclose(forth, back, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("larger", [0.02, -0.03])
def test_a_larger_disc_is_no_blur(larger):
    """In the size, and in nothing that a defocus would show; the rest of the second
    order is a tenth of it."""
    disc = 5 * PIXEL_MM * np.eye(2)
    light = jnp.asarray(3 * image(0.2, (1 + larger) * disc) + 0.1)
    found = patch_of(light, 0.2, disc, size_width=0.05, weight=1e8)
    assert found.nuisance[4] == pytest.approx(larger, rel=0.1)
    narrow = patch_of(light, 0.2, disc, size_width=1e-7, weight=1e8)
    assert abs(narrow.nuisance[4]) < 1e-3 * abs(larger)
    assert found.chi_squared < 0.05 * narrow.chi_squared


def test_a_diameter_counts_as_much_as_it_is_known():
    """An error of as much as its deviation costs one, whatever the dot's brightness."""
    disc = 5 * PIXEL_MM * np.eye(2)
    for bright in (1.0, 40.0):
        light = jnp.asarray(bright * image(0.2, 1.02 * disc))
        weight = 1e12 / bright**2
        found = patch_of(light, 0.2, disc, size_width=0.02, weight=weight)
        plain = patch_of(light, 0.2, disc, size_width=1e3, weight=weight)
        # What is left of the second order is in both.
        assert found.chi_squared - plain.chi_squared == pytest.approx(1.0, abs=0.2)


def patch_of(light, defocus_mm, disc_mm, size_width, weight=1.0):
    return _patch(defocus_mm, *dot_of(disc_mm, size_width=size_width), light, weight)


@jax.jit
def _patch(defocus_mm, dot, transfer, light, weight):
    seen = (_numbers(defocus_mm), dot, GREY, LAYOUT, SCALE)
    return equations_of(
        spot_and_pullback(*seen, RAYS)[0],
        only_group(rays_alone(*seen, 96)),
        light,
        weight * jnp.ones_like(light),
        -jnp.asarray(PLACE_MM),
        dot.cell_mm,
        VARIANCE_MM2,
        transfer,
    )

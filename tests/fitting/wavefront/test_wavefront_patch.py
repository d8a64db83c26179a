"""One patch: its gradient, and what brightness, background and place cannot change."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import GREY, LAYOUT, SCALE, Seidel, dots_at
from ray_moves import by_parameters, only_group, rays_alone

from lensfit.detect.dot_images import CELLS
from lensfit.fitting.wavefront.patch import equations_of
from lensfit.fitting.wavefront.rays import open_pupil_of, rays_of
from lensfit.fitting.wavefront.shapes import shape_jacobian
from lensfit.optics.pupil_nodes import RayGroup
from lensfit.psf.spot import Spot, image_of, profile_of

CELL = 0.008
CELL_MM = jnp.array([CELL, CELL])
VARIANCE = jnp.asarray(0.004**2)
POINTS = 200
PLACE = (11.0, 9.0)
RIMS = ((0.5, 1.1), (-0.6, 1.2))
TRUE = Seidel(12.0, -9.0, 14.0, 8.0, defocus_mm=(0.2,), rims=RIMS)
NEAR = Seidel(9.0, -6.0, 10.0, 10.0, defocus_mm=(0.18,), rims=((0.55, 1.15), RIMS[1]))


def _dot():
    dots = dots_at(np.array([PLACE]), 0, 0, CELL)
    return jax.tree.map(lambda a: jnp.asarray(a[0]), dots)


@partial(jax.jit, static_argnames=("points",))
def _rays(parameters, points=POINTS):
    return rays_alone(parameters, _dot(), GREY, LAYOUT, SCALE, points)


class Found(NamedTuple):
    """Of one patch, its pull led back by the rays' own derivatives."""

    matrix: jnp.ndarray
    gradient: jnp.ndarray
    chi_squared: jnp.ndarray
    nuisance: jnp.ndarray


@jax.jit
def _patch(rays, light, weight, corner, few=None):
    """The matrix is made of the same rays unless of a few."""
    few = rays if few is None else few
    few = only_group(few)
    found = equations_of(rays.spot, few, light, weight, corner, CELL_MM, VARIANCE)
    moves = by_parameters(rays, _dot(), LAYOUT, SCALE)
    gradient = jnp.einsum(
        "ri,rip->p", found.spot_gradient.landing_mm, moves.landing_slopes_mm
    )
    opened = found.spot_gradient.weight @ moves.weight_slopes
    gradient = gradient.at[LAYOUT.pupil_parameters].add(opened)
    jacobian = shape_jacobian(_dot(), LAYOUT, SCALE)
    matrix = jacobian.T @ found.matrix @ jacobian
    return Found(matrix, gradient, found.chi_squared, found.nuisance)


@pytest.fixture(scope="module")
def scene():
    """Light of one lens, rays of another, and a corner at which no shift is left."""
    middle = -CELL * CELLS / 2
    corner = jnp.array([middle, middle + 0.003])
    true = _rays(jnp.asarray(TRUE.parameters())).spot
    light = 3.0 * image_of(true, profile_of(true, corner, CELL_MM, CELLS, VARIANCE))
    rng = np.random.default_rng(5)
    light = light + jnp.asarray(rng.normal(0.02, 1e-3, light.shape))
    weight = jnp.asarray(rng.uniform(0.5, 1.5, light.shape)) * 1e4
    rays = _rays(jnp.asarray(NEAR.parameters()))
    for _ in range(12):
        corner = corner - _patch(rays, light, weight, corner).nuisance[2:4]
    return rays, light, weight, corner


@pytest.mark.slow
def test_the_gradient_is_that_of_chi_squared(scene):
    """Widths of rays held, as the derivatives take them."""
    rays, light, weight, corner = scene
    found = _patch(*scene)
    assert np.abs(found.nuisance[2:4]).max() < 1e-7
    start = jnp.asarray(NEAR.parameters())

    @jax.jit
    def both(steps):
        def one(step):
            spot = _rays(start + step).spot
            spot = Spot(spot.landing_mm, spot.weight, rays.spot.cell_mm2)
            moved = rays._replace(spot=spot)
            return _patch(moved, light, weight, corner).chi_squared

        return jax.lax.map(one, steps)

    size = np.full(LAYOUT.size, 1e-4)
    size[LAYOUT.blocks["coefficients"]] = 1e-2
    steps = jnp.asarray(np.diag(size))
    half = np.asarray(both(steps) - both(-steps)) / (4 * size)
    scale = np.sqrt(np.diag(found.matrix) * float(found.chi_squared))
    seen = np.diag(found.matrix) > 0
    np.testing.assert_allclose(
        np.asarray(found.gradient)[seen] / scale[seen],
        half[seen] / scale[seen],
        atol=2e-4,
    )
    assert np.abs(half[seen] / scale[seen]).max() > 0.1
    # Light of one wavelength has no band.
    assert not seen[LAYOUT.blocks["band_width"]].any()
    assert seen.sum() > LAYOUT.size - 1 - 8


@pytest.mark.slow
def test_the_gradient_is_the_image_s_whatever_the_matrix_is_made_of(scene):
    """Else the fit ends beside the minimum and takes that for convergence."""
    rays, light, weight, corner = scene
    few = _rays(jnp.asarray(NEAR.parameters()), POINTS // 4)
    found = _patch(rays, light, weight, corner, few)
    whole = _patch(*scene)
    np.testing.assert_allclose(found.gradient, whole.gradient, atol=_small(whole))
    assert not np.allclose(found.matrix, whole.matrix, rtol=0.01)


@pytest.mark.slow
def test_groups_of_few_rays_make_the_matrix_of_many(scene):
    """Light of one wavelength: the groups share out the rays of one spiral."""
    near = jnp.asarray(NEAR.parameters())
    groups, spiral, few = (
        np.asarray(_matrix_of_groups(near, count, jnp.asarray(groups), scene))
        for count, groups in ((96, 4), (384, 1), (96, 1))
    )
    size = np.sqrt(np.maximum(np.diag(spiral), 1e-30))
    size = np.outer(size, size)
    assert np.abs((groups - spiral) / size).max() < 1e-3
    assert np.abs((few - spiral) / size).max() > 0.1


@partial(jax.jit, static_argnames=("count",))
def _matrix_of_groups(near, count, groups, scene):
    rays, light, weight, corner = scene
    pupil = open_pupil_of(near, _dot(), LAYOUT, SCALE)

    def of_group(index):
        group = RayGroup(index, groups)
        return rays_of(near, _dot(), GREY, LAYOUT, SCALE, count, pupil, group)

    seen = (light, weight, corner, CELL_MM, VARIANCE)
    found = equations_of(rays.spot, (of_group, groups), *seen)
    jacobian = shape_jacobian(_dot(), LAYOUT, SCALE)
    return jacobian.T @ found.matrix @ jacobian


def test_a_gauss_newton_step_reaches_the_photograph(scene):
    """From nearby: the matrix is the curvature of what the gradient is the slope of."""
    _, light, weight, corner = scene
    found = _patch(*scene)
    want = TRUE.parameters() - NEAR.parameters()
    predicted = 2 * found.gradient @ want + want @ found.matrix @ want
    there = _patch(_rays(jnp.asarray(TRUE.parameters())), light, weight, corner)
    fallen = float(there.chi_squared - found.chi_squared)
    assert fallen < -0.9 * float(found.chi_squared)
    assert float(predicted) == pytest.approx(fallen, rel=0.25)


@pytest.mark.parametrize("gain", [0.2, 40.0])
def test_brightness_explains_nothing(scene, gain: float):
    rays, light, weight, corner = scene
    here, there = _patch(*scene), _patch(rays, gain * light, weight / gain**2, corner)
    np.testing.assert_allclose(there.chi_squared, here.chi_squared, rtol=1e-9)
    np.testing.assert_allclose(there.gradient, here.gradient, atol=_small(here))
    np.testing.assert_allclose(there.nuisance[0], gain * here.nuisance[0], rtol=1e-6)
    own = _patch(_rays(jnp.asarray(TRUE.parameters())), light, weight, corner)
    np.testing.assert_allclose(own.nuisance[0], 3.0, rtol=0.01)


def test_background_explains_nothing(scene):
    rays, light, weight, corner = scene
    here, there = _patch(*scene), _patch(rays, light + 7.0, weight, corner)
    np.testing.assert_allclose(there.chi_squared, here.chi_squared, rtol=1e-5)
    np.testing.assert_allclose(there.nuisance[1] - here.nuisance[1], 7.0, rtol=1e-5)


def _small(patch) -> float:
    return 1e-6 * float(np.abs(patch.gradient).max())


@pytest.mark.parametrize("shift", [(0.1, 0.0), (-0.05, 0.1)])
def test_a_small_shift_explains_nothing_and_is_measured(scene, shift):
    _, light, weight, corner = scene
    rays = _rays(jnp.asarray(TRUE.parameters()))
    for _ in range(5):
        corner = corner - _patch(rays, light, weight, corner).nuisance[2:4]
    moved = jnp.asarray(shift) * CELL
    here, there = (_patch(rays, light, weight, c) for c in (corner, corner + moved))
    image, after = (
        image_of(rays.spot, profile_of(rays.spot, c, CELL_MM, CELLS, VARIANCE))
        for c in (corner, corner + moved)
    )
    unexplained = float(jnp.sum(weight * (here.nuisance[0] * (image - after)) ** 2))
    change = abs(float(there.chi_squared - here.chi_squared))
    assert change < 0.02 * unexplained
    np.testing.assert_allclose(there.nuisance[2:4], moved, atol=0.01 * CELL)


def test_a_masked_cell_changes_nothing(scene):
    rays, light, weight, corner = scene
    masked = weight.at[10, 12].set(0.0).at[3, 3].set(0.0)
    one = _patch(rays, light, masked, corner)
    other = _patch(rays, light.at[10, 12].set(500.0).at[3, 3].set(-9.0), masked, corner)
    for name in ("matrix", "gradient", "chi_squared", "nuisance"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    seen = _patch(rays, light.at[10, 12].set(500.0), weight, corner)
    assert float(seen.chi_squared) > 10 * float(one.chi_squared)


def test_without_any_cell_nothing_is_learnt(scene):
    rays, light, weight, corner = scene
    dark = _patch(rays, light, jnp.zeros_like(weight), corner)
    for part in dark:
        assert np.all(np.isfinite(part))
    assert not np.any(dark.matrix)
    assert not np.any(dark.gradient)

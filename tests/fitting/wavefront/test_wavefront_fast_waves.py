"""Detail sharper than the waves that rays are drawn in, against charts drawn finely."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_squares import CELLS, whole_chart

from lensfit.fitting.wavefront.basis import Cells
from lensfit.fitting.wavefront.dot_arrays import undrawn
from lensfit.fitting.wavefront.fast_waves import FastImage
from lensfit.fitting.wavefront.patch import equations_of
from lensfit.fitting.wavefront.patch_image import patch_image
from lensfit.fitting.wavefront.rays import Rays
from lensfit.fitting.wavefront.waves import WAVES, basis_of, transfers_of
from lensfit.psf.spot import Spot, image_of

AROUND = 4
CELL_MM = 0.01
SIDES = {
    "almost square on": np.array([[30.0, 3.0], [-2.0, 28.0]]),
    "turned": np.array([[26.0, -14.0], [16.0, 24.0]]),
}


def rays(blur_cells, at_cells, count=512):
    """Spread as a Gaussian, about that place from the middle of the patch."""
    normal = jax.random.normal(jax.random.key(5), (count // 2, 2))
    normal = jnp.concatenate([normal, -normal])
    root = jnp.linalg.cholesky(normal.T @ normal / count)
    normal = jnp.linalg.solve(root, normal.T).T
    landing = CELL_MM * (blur_cells * normal + jnp.asarray(at_cells)[None])
    return Spot(landing, jnp.full(count, 1 / count), jnp.zeros(count))


def transfer_of(sides):
    """Transfer function of one corner, with its sharpest detail."""
    broad = undrawn(1)._replace(
        square_mm=CELL_MM * sides[None], window_cells=np.full(1, 8.0)
    )
    known = broad, np.full((1, 2), CELL_MM), CELLS, [None]
    return jax.tree.map(lambda a: jnp.asarray(a[0]), transfers_of(*known, sharp=True))


CORNER_MM, CELL = jnp.full(2, -CELL_MM * CELLS / 2), jnp.full(2, CELL_MM)
NOTHING = jnp.zeros(2)
PATCH = Cells(CORNER_MM, CELL, CELLS)


def slow_light(spot, transfer):
    basis = basis_of(CORNER_MM, CELL, CELLS, transfer, WAVES)
    return basis.cell_light(image_of(spot, basis.profile(spot, NOTHING)))


@pytest.mark.parametrize("at_cells", [(0.0, 0.0), (0.3, -0.2), (0.45, 0.5)])
@pytest.mark.parametrize("sides", SIDES.values(), ids=SIDES.keys())
def test_a_sharp_corner_is_as_the_chart_drawn_finely(sides, at_cells):
    transfer = transfer_of(sides)
    spot = rays(0.1, at_cells)
    whole = whole_chart(sides, 0.1, AROUND, at_cells=at_cells, fine=32)
    wanted = whole[AROUND:-AROUND, AROUND:-AROUND]
    without = np.asarray(slow_light(spot, transfer)) - wanted
    sharp = FastImage(spot, transfer.fast, PATCH, NOTHING).light
    off = without + np.asarray(sharp).reshape(CELLS, CELLS)
    assert np.abs(off).max() < 0.02
    assert np.sqrt(np.mean(off**2)) < 0.35 * np.sqrt(np.mean(without**2))


def test_a_blur_of_a_cell_leaves_no_fast_waves():
    fast = transfer_of(SIDES["almost square on"]).fast
    spot = rays(1.0, (0.2, 0.1))
    sharp = FastImage(spot, fast, PATCH, NOTHING).light
    assert np.abs(sharp).max() < 1e-5


SHAPES = 5
LIT = 2
"""Shapes that move rays, and the last of them that change their weights."""


def shapes_of(spot):
    """Rays of a spot, with shapes drawn by chance."""
    place, light = jax.random.split(jax.random.key(9))
    count = len(spot.weight)
    moved = CELL_MM * jax.random.normal(place, (SHAPES, 2, count))
    lit = jax.random.normal(light, (LIT, count)) / count
    return Rays(spot, moved, lit - jnp.mean(lit, 1, keepdims=True))


def moved_by(rays_, amounts):
    """The spot after these amounts of each shape."""
    spot = rays_.spot
    landing = jnp.einsum("s,sir->ri", amounts, rays_.landing_slopes_mm)
    weight = amounts[-LIT:] @ rays_.weight_slopes
    return Spot(spot.landing_mm + landing, spot.weight + weight, spot.cell_mm2)


@pytest.mark.parametrize("sides", SIDES.values(), ids=SIDES.keys())
def test_derivatives_by_shapes_are_those_of_the_light(sides):
    fast = transfer_of(sides).fast
    spot = rays(0.1, (0.3, -0.2))
    few = shapes_of(spot)

    def light(amounts):
        return FastImage(moved_by(few, amounts), fast, PATCH, NOTHING).light

    wanted = jax.jacfwd(light)(jnp.zeros(SHAPES))
    found = FastImage(spot, fast, PATCH, NOTHING).design(few)
    assert np.allclose(found, wanted, rtol=1e-6, atol=1e-9)
    pull = jax.random.normal(jax.random.key(2), (CELLS**2,))
    image = FastImage(spot, fast, PATCH, NOTHING)
    by_spot = image.spot_gradient(pull)
    traced = jnp.einsum("ri,sir->s", by_spot.landing_mm, few.landing_slopes_mm)
    traced = traced.at[-LIT:].add(few.weight_slopes @ by_spot.weight)
    assert np.allclose(traced, pull @ wanted, rtol=1e-6, atol=1e-9)


def test_a_sharp_edge_that_moved_is_explained_by_its_shift():
    transfer = transfer_of(SIDES["almost square on"])
    patch = CORNER_MM, CELL, CELLS, NOTHING, WAVES
    moved_mm = CELL_MM * np.array([0.15, -0.1])
    still, moved = rays(0.1, (0.2, 0.1)), rays(0.1, (0.35, 0.0))
    light = patch_image(moved, transfer, *patch).light
    still_light = patch_image(still, transfer, *patch).light
    few = shapes_of(still)
    fast = equations_of(
        still,
        (lambda _: few, jnp.asarray(1)),
        light.reshape(CELLS, CELLS),
        jnp.full((CELLS, CELLS), 1e6),
        CORNER_MM,
        CELL,
        NOTHING,
        transfer,
    )
    assert np.allclose(fast.nuisance[2:4], moved_mm, atol=1e-3 * CELL_MM)
    assert fast.chi_squared < 1e-3 * 1e6 * np.sum((light - still_light) ** 2)


def test_the_matrix_is_that_of_an_image_with_its_sharpest_detail():
    """Half the second difference of the cost along a shape is its curvature, when the
    photograph is the image itself."""
    transfer = transfer_of(SIDES["turned"])
    spot = rays(0.1, (0.2, 0.1))
    patch = CORNER_MM, CELL, CELLS, NOTHING, WAVES
    light = patch_image(spot, transfer, *patch).light.reshape(CELLS, CELLS)
    few = shapes_of(spot)

    def seen(amounts):
        at = moved_by(few, amounts)
        shapes = (lambda _: few._replace(spot=at), jnp.asarray(1))
        known = jnp.full((CELLS, CELLS), 1e6)
        return equations_of(
            at, shapes, light, known, CORNER_MM, CELL, NOTHING, transfer
        )

    matrix = seen(jnp.zeros(SHAPES)).matrix
    step = 1e-3
    for shape in range(SHAPES):
        both = [
            seen(jnp.zeros(SHAPES).at[shape].set(way)).chi_squared
            for way in (step, -step)
        ]
        curvature = (both[0] + both[1]) / (2 * step**2)
        assert np.isclose(matrix[shape, shape], curvature, rtol=0.05)

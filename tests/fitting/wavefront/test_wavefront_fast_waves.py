"""Detail sharper than the waves that rays are drawn in, against charts drawn finely."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from lensfit.fitting.wavefront.dot_arrays import undrawn
from lensfit.fitting.wavefront.fast_waves import fast_light, fast_waves_of
from lensfit.fitting.wavefront.waves import WAVES, basis_of, transfers_of
from lensfit.psf.spot import Spot, image_of

CELLS, FINE, MARGIN_CELLS = 24, 32, 4
CELL_MM = 0.01
SIDES = {
    "almost square on": np.array([[30.0, 3.0], [-2.0, 28.0]]),
    "turned": np.array([[26.0, -14.0], [16.0, 24.0]]),
}


def chart(sides, blur_cells, at_cells):
    """Means over cells of squares that meet at a place from the middle, behind a
    Gaussian."""
    wide = CELLS + 2 * MARGIN_CELLS
    along = (np.arange(wide * FINE) + 0.5) / FINE - wide / 2
    places = np.stack(np.meshgrid(along, along), -1) - at_cells
    square = np.floor(places @ np.linalg.inv(sides).T)
    bright = (square.sum(-1) % 2 == 0).astype(float)
    blurred = gaussian_filter(bright, blur_cells * FINE, truncate=6)
    cells = blurred.reshape(wide, FINE, wide, FINE).mean((1, 3))
    return cells[MARGIN_CELLS:-MARGIN_CELLS, MARGIN_CELLS:-MARGIN_CELLS]


def rays(blur_cells, at_cells, count=512):
    """Spread as a Gaussian, about that place from the middle of the patch."""
    normal = jax.random.normal(jax.random.key(5), (count // 2, 2))
    normal = jnp.concatenate([normal, -normal])
    root = jnp.linalg.cholesky(normal.T @ normal / count)
    normal = jnp.linalg.solve(root, normal.T).T
    landing = CELL_MM * (blur_cells * normal + jnp.asarray(at_cells)[None])
    return Spot(landing, jnp.full(count, 1 / count), jnp.zeros(count))


def drawing(sides):
    """Transfer function and fast waves of one corner."""
    broad = undrawn(1)._replace(
        square_mm=CELL_MM * sides[None], window_cells=np.full(1, 8.0)
    )
    known = broad, np.full((1, 2), CELL_MM), CELLS, [None]
    both = transfers_of(*known), fast_waves_of(*known)
    return jax.tree.map(lambda a: jnp.asarray(a[0]), both)


CORNER_MM, CELL = jnp.full(2, -CELL_MM * CELLS / 2), jnp.full(2, CELL_MM)
NOTHING = jnp.zeros(2)


def slow_light(spot, transfer):
    basis = basis_of(CORNER_MM, CELL, CELLS, transfer, WAVES)
    return basis.cell_light(image_of(spot, basis.profile(spot, NOTHING)))


@pytest.mark.parametrize("at_cells", [(0.0, 0.0), (0.3, -0.2), (0.45, 0.5)])
@pytest.mark.parametrize("sides", SIDES.values(), ids=SIDES.keys())
def test_a_sharp_corner_is_as_the_chart_drawn_finely(sides, at_cells):
    transfer, fast = drawing(sides)
    spot = rays(0.1, at_cells)
    wanted = chart(sides, np.hypot(0.1, 0.05), np.array(at_cells))
    without = np.asarray(slow_light(spot, transfer)) - wanted
    sharp = fast_light(spot, fast, CORNER_MM, CELL, CELLS, NOTHING)
    off = without + np.asarray(sharp)
    assert np.abs(off).max() < 0.02
    assert np.sqrt(np.mean(off**2)) < 0.35 * np.sqrt(np.mean(without**2))


def test_a_blur_of_a_cell_leaves_no_fast_waves():
    _, fast = drawing(SIDES["almost square on"])
    sharp = fast_light(rays(1.0, (0.2, 0.1)), fast, CORNER_MM, CELL, CELLS, NOTHING)
    assert np.abs(sharp).max() < 1e-5

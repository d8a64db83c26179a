"""Detail sharper than the waves that rays are drawn in, against charts drawn finely."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_squares import CELLS, whole_chart

from lensfit.fitting.wavefront.dot_arrays import undrawn
from lensfit.fitting.wavefront.fast_waves import fast_light
from lensfit.fitting.wavefront.waves import WAVES, basis_of, transfers_of
from lensfit.psf.spot import LEAST_SIGMA_PX, Spot, image_of

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


def slow_light(spot, transfer):
    basis = basis_of(CORNER_MM, CELL, CELLS, transfer, WAVES)
    return basis.cell_light(image_of(spot, basis.profile(spot, NOTHING)))


@pytest.mark.parametrize("at_cells", [(0.0, 0.0), (0.3, -0.2), (0.45, 0.5)])
@pytest.mark.parametrize("sides", SIDES.values(), ids=SIDES.keys())
def test_a_sharp_corner_is_as_the_chart_drawn_finely(sides, at_cells):
    transfer = transfer_of(sides)
    spot = rays(0.1, at_cells)
    width = np.hypot(0.1, LEAST_SIGMA_PX)
    whole = whole_chart(sides, width, AROUND, at_cells=at_cells, fine=32)
    wanted = whole[AROUND:-AROUND, AROUND:-AROUND]
    without = np.asarray(slow_light(spot, transfer)) - wanted
    sharp = fast_light(spot, transfer.fast, CORNER_MM, CELL, CELLS, NOTHING)
    off = without + np.asarray(sharp)
    assert np.abs(off).max() < 0.02
    assert np.sqrt(np.mean(off**2)) < 0.35 * np.sqrt(np.mean(without**2))


def test_a_blur_of_a_cell_leaves_no_fast_waves():
    fast = transfer_of(SIDES["almost square on"]).fast
    sharp = fast_light(rays(1.0, (0.2, 0.1)), fast, CORNER_MM, CELL, CELLS, NOTHING)
    assert np.abs(sharp).max() < 1e-5

"""The opening: areas in closed form, blades, symmetry, smooth derivatives."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from lensfit.optics.pupil import (
    Pupil,
    clear_pupil,
    opening_area,
    relative_illumination,
    stretch_matrix,
)
from lensfit.optics.pupil_nodes import pupil_nodes

ONE = jnp.asarray(1.0)
SHARP = 2000.0
_area = jax.jit(opening_area, static_argnums=3)
_illumination = jax.jit(relative_illumination)
_nodes = jax.jit(pupil_nodes, static_argnums=(3, 4))


def cats_eye() -> Pupil:
    return replace(
        clear_pupil(2),
        rim_shift=jnp.array([[0.5, 0.1], [-0.6, 0.05]]),
        rim_radius=jnp.array([[1.05, 0.05], [1.1, -0.05]]),
        stop_shift=jnp.array([0.03, -0.01]),
        stretch=jnp.array([[-0.15, 0.02], [-0.04, 0.01]]),
    )


def lens_area(radius: float, distance: float) -> float:
    """Intersection of the unit disc with a disc (the textbook's lens)."""
    d, r = distance, radius
    a = np.arccos((d * d + 1 - r * r) / (2 * d))
    b = np.arccos((d * d + r * r - 1) / (2 * d * r))
    kite = np.sqrt((-d + 1 + r) * (d + 1 - r) * (d - 1 + r) * (d + 1 + r)) / 2
    return a + r * r * b - kite


@pytest.mark.parametrize("distance", [0.3, 0.9, 1.5])
def test_two_discs_leave_a_lens(distance: float):
    one = replace(clear_pupil(1), rim_shift=jnp.array([[distance, 0.0]]),
                  rim_radius=jnp.array([[0.9, 0.0]]))  # fmt: skip
    area = _area(jnp.array([0.6, 0.8]), ONE, one, SHARP)
    np.testing.assert_allclose(area, lens_area(0.9, distance), rtol=2e-3)


def test_the_smooth_corner_costs_less_than_a_per_cent():
    h = jnp.array([0.6, 0.8])
    area, exact = (_area(h, ONE, cats_eye(), p) for p in (128.0, SHARP))
    np.testing.assert_allclose(area, exact, rtol=0.006)


@pytest.mark.parametrize("curvature", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("blades", [5, 8])
def test_blades_leave_the_area_of_the_round_stop(blades: int, curvature: float):
    one = replace(clear_pupil(0, blades), blade_curvature=jnp.asarray(curvature))
    for sharpness in (128.0, SHARP):
        area = _area(jnp.zeros(2), jnp.asarray(0.5), one, sharpness)
        np.testing.assert_allclose(area, np.pi / 4, rtol=1e-3)


def test_straight_blades_make_a_polygon_with_a_corner_where_asked():
    turn = 0.3
    one = replace(clear_pupil(0, 6), blade_rotation_rad=jnp.asarray(turn))
    u = np.asarray(_nodes(jnp.zeros(2), ONE, one, 20000, SHARP).u)
    apothem = np.sqrt(np.pi / (6 * np.tan(np.pi / 6)))
    sides = turn + np.pi / 6 + np.pi / 3 * np.arange(6)
    reach = u @ np.stack([np.cos(sides), np.sin(sides)])
    np.testing.assert_allclose(reach.max(axis=0), apothem, rtol=0.01)
    corner = np.hypot(*u.T).argmax()
    away = (np.arctan2(*u[corner, ::-1]) - turn) % (np.pi / 3)
    assert min(away, np.pi / 3 - away) < 0.05


@pytest.mark.parametrize("blades", [5, 8])
def test_slightly_hollow_blades_are_next_to_straight_ones(blades: int):
    """A fit may end there; a pencil that misses an arc must not become NaN."""

    def area(curvature: float) -> float:
        one = replace(clear_pupil(2, blades), blade_curvature=jnp.asarray(curvature))
        return float(_area(jnp.array([0.7, 0.2]), jnp.asarray(0.5), one))

    assert area(-1e-6) == pytest.approx(area(0.0), rel=1e-5)
    assert area(-0.05) == pytest.approx(area(0.0), rel=0.02)


def test_roundness_one_is_round():
    one = replace(clear_pupil(0, 7), blade_curvature=ONE)
    u = np.asarray(_nodes(jnp.zeros(2), ONE, one, 500, SHARP).u)
    plain = np.asarray(_nodes(jnp.zeros(2), ONE, clear_pupil(), 500, SHARP).u)
    np.testing.assert_allclose(u, plain, atol=2e-3)


def test_nodes_fill_the_opening_evenly():
    """Area, centroid and second moments against a fine grid over the discs."""
    h, one = jnp.array([0.5, 0.4]), cats_eye()
    nodes = _nodes(h, ONE, one, 4096, SHARP)
    x = np.linspace(-1.3, 1.3, 1200)
    grid = np.stack(np.meshgrid(x, x), -1).reshape(-1, 2)
    square = float(h @ h)
    inside = np.hypot(*(grid - np.asarray(h) * (0.03 - 0.01 * square)).T) < 1
    shifts, radii = np.asarray(one.rim_shift), np.asarray(one.rim_radius)
    for (a0, a1), (r0, r1) in zip(shifts, radii, strict=True):
        centre = np.asarray(h) * (a0 + a1 * square)
        inside &= np.hypot(*(grid - centre).T) < r0 + r1 * square
    truth = grid[inside] @ np.asarray(stretch_matrix(h, one))
    w, u = np.asarray(nodes.weight), np.asarray(nodes.u)
    np.testing.assert_allclose(w @ u, truth.mean(axis=0), atol=2e-3)
    np.testing.assert_allclose((u.T * w) @ u, truth.T @ truth / len(truth), atol=2e-3)


def test_opening_turns_with_the_field():
    """Illumination depends on the field's radius alone in a centred lens."""
    way = [0.9 * jnp.array([np.cos(a), np.sin(a)]) for a in (0.0, 0.7, 2.9)]
    at = [_illumination(h, ONE, cats_eye()) for h in way]
    np.testing.assert_allclose(at, at[0], rtol=1e-4)
    assert 0.2 < at[0] < 0.9
    axis = _illumination(jnp.zeros(2), ONE, cats_eye())
    np.testing.assert_allclose(axis, 1.0, rtol=1e-12)


def test_stopping_down_frees_the_corner():
    corner = jnp.array([0.8, 0.6])
    stops = [_illumination(corner, jnp.asarray(s), cats_eye()) for s in (1, 0.5)]
    assert stops[1] > stops[0] + 0.1


def test_a_squeezed_pupil_is_an_ellipse():
    squeezed = replace(clear_pupil(), squeeze=jnp.asarray(np.log(0.5)))
    u = np.asarray(_nodes(jnp.zeros(2), ONE, squeezed, 4000).u)
    np.testing.assert_allclose(np.ptp(u[:, 0]) / np.ptp(u[:, 1]), 0.5, rtol=0.01)


@jax.jit
def _summary(h, same, rims, shift, stop, curvature):
    one = replace(same, rim_radius=rims, rim_shift=shift, blade_curvature=curvature)
    nodes = pupil_nodes(h, stop, one, 96)
    return jnp.concatenate([nodes.weight @ nodes.u, nodes.u[5], nodes.area[None]])


@jax.jit
def _summary_along(h, same, args, way):
    """Derivative along a way."""
    return jax.jvp(lambda *moved: _summary(h, same, *moved), args, way)[1]


@pytest.mark.parametrize(
    "place", [[0.0, 0.0], [1e-9, 0.0], [0.6, 0.8]], ids=["axis", "near", "field"]
)
@pytest.mark.parametrize("blades", [0, 8])
def test_derivatives_agree_with_differences(place, blades):
    """With rims that coincide with the stop on the axis: three boundaries at once."""
    same = replace(
        cats_eye(), rim_radius=jnp.array([[1.0, 0.05], [1.0, -0.05]]), blades=blades
    )

    args = (same.rim_radius, same.rim_shift, ONE, jnp.asarray(0.2))
    rng = np.random.default_rng(2)
    way = tuple(jnp.asarray(rng.normal(size=a.shape)) for a in args)
    h = jnp.asarray(place)
    slope = _summary_along(h, same, args, way)
    step = 1e-6
    ahead, behind = (
        _summary(h, same, *(a + s * w for a, w in zip(args, way, strict=True)))
        for s in (step, -step)
    )
    np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), atol=2e-6)


def test_a_closed_opening_has_no_light_and_finite_derivatives():
    far = replace(clear_pupil(1), rim_shift=jnp.array([[3.0, 0.0]]),
                  rim_radius=jnp.array([[1.0, 0.0]]))  # fmt: skip
    h = jnp.array([1.0, 0.0])

    def light(one):
        nodes = pupil_nodes(h, ONE, one, 64)
        return nodes.area + jnp.sum(nodes.u**2)

    value, slope = jax.jit(jax.value_and_grad(light))(far)
    assert np.isfinite(value)
    assert _area(h, ONE, far) < 0.01
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slope))


@pytest.mark.parametrize("rays", [96, 384, 1536])
def test_rays_of_each_wavelength_fill_the_opening_as_evenly_as_all(rays):
    """By the distance of the nearest one, in radii of a ray's share of the disc; every
    third ray of a spiral of golden angles has 1.0 to 1.26."""
    u = np.asarray(_nodes(jnp.zeros(2), ONE, clear_pupil(), rays, SHARP).u)
    for every in (1, 3):
        mine = u[::every]
        nearest, _ = cKDTree(mine).query(mine, 2)
        share = np.sqrt(1 / len(mine))
        assert np.median(nearest[:, 1]) > 1.3 * share, every

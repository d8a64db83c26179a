"""Rays of a dot: where they land, and every derivative against finite differences."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import GREY, LAYOUT, SCALE, Seidel, dots_at
from ray_moves import by_parameters, rays_alone

from lensfit.fitting.wavefront.light_centroid import centroid_slopes_mm, centroids_mm
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.rays import (
    Rays,
    _turn_rad,
    spot_and_pullback,
)
from lensfit.fitting.wavefront.shapes import Colour, colours_of
from lensfit.fitting.wavefront.term_groups import terms_that_change_with_focus
from lensfit.optics.terms import rotational_terms
from lensfit.psf.spot import Spot

TINY = Layout(
    rotational_terms(3),
    rotational_terms(1),
    groups=2,
    stops=1,
    rims=2,
    focus_terms=terms_that_change_with_focus(rotational_terms(3)),
)
WAVELENGTHS_NM = jnp.array([[590.0, 620.0], [530.0, 545.0], [440.0, 490.0]])
BLUE = 2
POINTS = 40
PLACES = {"axis": (0.0, 0.0), "middle": (6.0, -5.0), "edge": (16.0, 12.0)}


def dot_of(place, stop: int = 0, blades: int = 0):
    """A dot before a chart that is nearer than the reference distance."""
    dots = dots_at(np.array([place]), 1, stop, 0.01)._replace(
        lateral_mm=np.full((1, 3, 2, 2), [[0.001, -0.001], [-0.001, 0.001]]),
        blades=np.full(1, float(blades)),
        vergence=np.full(1, 1 / 1700),
        focus=np.full(1, -0.6),
    )
    return jax.tree.map(lambda a: jnp.asarray(a[0]), dots)


def parameters_of(defocus_mm: float, rim: tuple[float, float]) -> np.ndarray:
    """Everything in use; `rim` is shift and radius of one of the rims."""
    found, blocks = np.zeros(TINY.size), TINY.blocks
    found[blocks["coefficients"]] = [0.0, 12.0, -9.0, 14.0, 8.0]
    found[blocks["colour"]] = [3.0, -1.0]
    found[blocks["focus_change"]] = [3.0, 5.0, -2.0, 4.0]
    found[blocks["defocus"]] = [0.4, defocus_mm]
    found[blocks["exit_pupil"]] = [0.1, 0.05]
    found[blocks["band_width"]] = [0.3]
    found[blocks["rim_shift"]] = [rim[0], 0.05, -0.6, 0.0]
    found[blocks["rim_radius"]] = [rim[1], -0.05, 1.2, 0.0]
    found[blocks["stop_shift"]] = [0.03, -0.01]
    found[blocks["stretch"]] = [-0.15, 0.02, -0.04, 0.01]
    found[blocks["iris"]] = [0.02, 0.3, 0.2]
    found[blocks["stop_ratio"]] = [0.02]
    return found


def _blue(parameters, dot) -> Colour:
    colours = colours_of(parameters, dot, WAVELENGTHS_NM, TINY)
    return jax.tree.map(lambda of_channels: of_channels[BLUE], colours)


def _rays(parameters, dot) -> Rays:
    return rays_alone(parameters, dot, _blue(parameters, dot), TINY, SCALE, POINTS)


@jax.jit
def _exact(parameters, dot):
    rays = _rays(parameters, dot)
    return by_parameters(rays, dot, TINY, SCALE)


@jax.jit
def _weight_slope(parameters, dot):
    """d weight / d parameter, by JAX."""

    def weight(numbers):
        return _rays(numbers, dot).spot.weight

    return jax.jacfwd(weight)(parameters)


@jax.jit
def _differences(parameters, dot):
    """Central differences of landing and weight by every parameter, last axis."""

    def moved(step):
        spot = _rays(parameters + step, dot).spot
        return spot.landing_mm, spot.weight

    size = jnp.full(TINY.size, 1e-5).at[TINY.blocks["coefficients"]].set(1e-2)
    steps = jnp.diag(size)
    after, before = jax.vmap(moved)(steps), jax.vmap(moved)(-steps)
    landing, weight = (
        jnp.moveaxis(a - b, 0, -1) / (2 * size.reshape((1,) * (a.ndim - 1) + (-1,)))
        for a, b in zip(after, before, strict=True)
    )
    return landing, weight


@partial(jax.jit, static_argnames=("layout", "points"))
def _spot(parameters, dot, colour, layout, points):
    return spot_and_pullback(parameters, dot, colour, layout, SCALE, points)[0]


@jax.jit
def _led_back(parameters, dot, by_spot):
    colour = _blue(parameters, dot)
    spot, back = spot_and_pullback(parameters, dot, colour, TINY, SCALE, POINTS)
    return spot, back(by_spot)


@jax.jit
def _centroids(parameters, dot):
    return centroids_mm(parameters, dot, WAVELENGTHS_NM, TINY, SCALE)


@jax.jit
def _centroid_slopes(parameters, dot):
    """As the fit computes them, and by JAX."""
    return (
        centroid_slopes_mm(parameters, dot, WAVELENGTHS_NM, TINY, SCALE),
        jax.jacfwd(centroids_mm)(parameters, dot, WAVELENGTHS_NM, TINY, SCALE),
    )


def _agree(parameters: np.ndarray, dot) -> None:
    exact = _exact(jnp.asarray(parameters), dot)
    landing, weight = _differences(jnp.asarray(parameters), dot)
    for name, where in TINY.blocks.items():
        found, wanted = exact.landing_slopes_mm[..., where], landing[..., where]
        size = float(np.abs(wanted).max())
        np.testing.assert_allclose(
            found, wanted, rtol=0, atol=1e-5 * size + 1e-9, err_msg=name
        )
    opened = weight[:, TINY.pupil_parameters]
    size = float(np.abs(opened).max())
    np.testing.assert_allclose(
        exact.weight_slopes, opened, rtol=0, atol=1e-5 * size + 1e-9
    )
    before_opening = _weight_slope(jnp.asarray(parameters), dot)
    before_opening = before_opening[:, : TINY.pupil_parameters.start]
    np.testing.assert_array_equal(before_opening, np.zeros_like(before_opening))
    np.testing.assert_allclose(np.sum(exact.weight_slopes, 0), 0.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("blades", [0, 7])
@pytest.mark.parametrize("defocus_mm", [0.0, -0.3])
@pytest.mark.parametrize("place", PLACES)
def test_derivatives_agree_with_differences(place, defocus_mm, blades):
    parameters = parameters_of(defocus_mm, (0.5, 1.1))
    _agree(parameters, dot_of(PLACES[place], int(blades > 0), blades))


@pytest.mark.parametrize("touches", ["inside", "outside"])
def test_derivatives_hold_where_a_rim_just_touches(touches):
    """From within, where it clips nothing, and where it leaves the centre only."""
    parameters = parameters_of(0.2, (0.5, 1.5 if touches == "inside" else 0.5))
    parameters[TINY.blocks["stop_shift"]] = 0.0
    parameters[TINY.blocks["rim_shift"]][1] = 0.0
    parameters[TINY.blocks["rim_radius"]][1] = 0.0
    _agree(parameters, dot_of(PLACES["edge"]))


@pytest.mark.parametrize("place", PLACES)
def test_derivatives_are_led_back_as_the_rays_own_say(place):
    """What the gradient is made of, against every derivative of every ray."""
    parameters = jnp.asarray(parameters_of(0.2, (0.5, 1.1)))
    dot = dot_of(PLACES[place], 1, 7)
    rays = _exact(parameters, dot)
    rng = np.random.default_rng(4)
    landing, weight, cell = (
        jnp.asarray(rng.normal(size=a.shape)) for a in jax.tree.leaves(rays.spot)
    )

    spot, found = _led_back(parameters, dot, Spot(landing, weight, cell))
    wanted = np.einsum("ri,rip->p", landing, rays.landing_slopes_mm)
    # Those that lead the way are evenly lit.
    lit = spot.weight / rays.spot.weight
    wanted[TINY.pupil_parameters] += (weight * lit) @ rays.weight_slopes
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(spot.landing_mm, rays.spot.landing_mm, atol=1e-12)


@pytest.mark.parametrize("place", PLACES)
def test_a_centroid_goes_as_its_slopes_say(place):
    """But for how the light over the opening changes, which is taken as it is."""
    parameters, dot = jnp.asarray(parameters_of(0.2, (0.5, 1.1))), dot_of(PLACES[place])
    found, wanted = _centroid_slopes(parameters, dot)
    for name, where in TINY.blocks.items():
        size = float(np.abs(wanted[..., where]).max())
        np.testing.assert_allclose(
            found[..., where], wanted[..., where],
            rtol=0, atol=0.02 * size + 1e-9, err_msg=name,
        )  # fmt: skip


def test_every_block_moves_or_brightens_rays_somewhere():
    """So that the comparisons above compare something."""
    stopped = _exact(
        jnp.asarray(parameters_of(0.3, (0.5, 0.6))), dot_of(PLACES["edge"], 1, 7)
    )
    reach = np.abs(stopped.landing_slopes_mm).max((0, 1))
    for name, where in TINY.blocks.items():
        seen = reach[where][1:] if name == "defocus" else reach[where]
        assert np.all(seen > 1e-6), name
    assert reach[TINY.blocks["defocus"]][0] == 0  # another group's


def test_rays_land_where_the_closed_forms_say():
    lens = Seidel(12.0, -9.0, 14.0, 8.0, 5.0, defocus_mm=(0.0, -0.3))
    parameters = jnp.asarray(lens.parameters())
    for place in PLACES.values():
        dots = dots_at(np.array([place]), 1, 0, 0.01)
        dot = jax.tree.map(lambda a: jnp.asarray(a[0]), dots)
        spot = _spot(parameters, dot, GREY, LAYOUT, POINTS)
        u = _evenly(POINTS, _turn_rad(dot))
        wanted = lens.landing_mm(u, np.array(place), 1)
        # The p-norm of three boundaries that do not clip leaves a per mille.
        np.testing.assert_allclose(spot.landing_mm, wanted, atol=3e-4)
        assert np.abs(wanted).max() > 0.05


def _evenly(count: int, turn_rad: float) -> np.ndarray:
    """The unit disc's spiral of angles of a turn over the root of 3."""
    k = np.arange(count)
    angle = k * 56 % 97 * (2 * np.pi / 97) + turn_rad
    reach = np.sqrt((k + 0.5) / count)
    return reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)


@pytest.mark.slow
def test_centroids_are_the_mean_of_a_dense_spot():
    parameters = jnp.asarray(parameters_of(0.3, (0.5, 1.1)))
    for place in PLACES.values():
        dot = dot_of(place)
        found = np.asarray(_centroids(parameters, dot))
        colours = colours_of(parameters, dot, WAVELENGTHS_NM, TINY)
        for k in range(3):
            colour = jax.tree.map(lambda of_channels, k=k: of_channels[k], colours)
            spot = _spot(parameters, dot, colour, TINY, 8000)
            dense = np.asarray(spot.weight) @ np.asarray(spot.landing_mm)
            np.testing.assert_allclose(found[k], dense, atol=2e-5)
        assert place == (0.0, 0.0) or np.hypot(*found[1]) > 5e-3

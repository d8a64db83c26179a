"""An anamorphic lens in the wavefront fit: what it has besides, and its derivatives."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import GREY, LAYOUT, SCALE, Seidel, Shot, dots_at, photographed
from ray_moves import by_parameters, rays_alone

from lensfit.fitting.wavefront.dot_arrays import dot_aperture_variance_mm2
from lensfit.fitting.wavefront.parameters import Layout
from lensfit.fitting.wavefront.rays import spot_and_pullback
from lensfit.fitting.wavefront.start_values import defocus_size_mm
from lensfit.fitting.wavefront.term_groups import (
    FINE,
    candidate_term_groups,
    deviation_of,
)
from lensfit.optics.depth import Sections
from lensfit.optics.terms import rotational_terms, two_mirror_terms
from lensfit.psf.spot import Spot

TERMS = rotational_terms(3) + two_mirror_terms(3)
TINY = Layout(TERMS, (), groups=2, stops=1, rims=2, anamorphic=True)
POINTS, SQUEEZE = 40, 1.9
PLACES = [(0.0, 0.0), (11.0, -7.0), (-3.0, 9.0)]
PER_DEFOCUS = SQUEEZE**-2 - 1


def dot_of(place):
    dots = dots_at(np.array([place]), 1, 0, 0.01)._replace(
        lateral_mm=np.zeros((1, 3, 1, 2)),
        vergence=np.full(1, 1 / 1700),
        sections=Sections(np.array([[0.97, 0.02]]), np.full(1, PER_DEFOCUS)),
    )
    return jax.tree.map(lambda a: jnp.asarray(a[0]), dots)


def parameters() -> np.ndarray:
    rng = np.random.default_rng(5)
    found, blocks = np.zeros(TINY.size), TINY.blocks
    found[blocks["coefficients"]] = rng.normal(0, 8.0, len(TERMS))
    found[blocks["defocus"]] = [0.4, -0.3]
    found[blocks["astigmatic_offset"]] = [0.1, 0.07]
    found[blocks["rim_shift"]] = [0.5, 0.05, -0.6, 0.0]
    found[blocks["rim_radius"]] = [1.1, -0.05, 1.2, 0.0]
    found[blocks["iris"]] = [0.1, 0.3, 0.2]
    return found


@jax.jit
def _rays(numbers, dot):
    rays = rays_alone(numbers, dot, GREY, TINY, SCALE, POINTS)
    return by_parameters(rays, dot, TINY, SCALE)


@jax.jit
def _differences(numbers, dot):
    def landed(step):
        return _rays(numbers + step, dot).spot.landing_mm

    size = jnp.full(TINY.size, 1e-5).at[TINY.blocks["coefficients"]].set(1e-2)
    ends = [jax.vmap(landed)(way * jnp.diag(size)) for way in (1, -1)]
    return jnp.moveaxis(ends[0] - ends[1], 0, -1) / (2 * size)[None, None]


@jax.jit
def _led_back(numbers, dot, by_spot):
    spot, back = spot_and_pullback(numbers, dot, GREY, TINY, SCALE, POINTS)
    return spot, back(by_spot)


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_derivatives_agree_with_differences(place):
    numbers, dot = jnp.asarray(parameters()), dot_of(place)
    found, wanted = _rays(numbers, dot).landing_slopes_mm, _differences(numbers, dot)
    for name, where in TINY.blocks.items():
        size = float(np.abs(wanted[..., where]).max(initial=0.0))
        np.testing.assert_allclose(
            found[..., where], wanted[..., where],
            rtol=0, atol=1e-5 * size + 1e-9, err_msg=name,
        )  # fmt: skip
    own, other = (
        found[..., TINY.blocks["astigmatic_offset"].start + k] for k in (1, 0)
    )
    assert np.abs(own).max() > 1e-3
    assert np.abs(other).max() == 0


@pytest.mark.parametrize("place", PLACES)
def test_derivatives_are_led_back_as_the_rays_own_say(place):
    numbers, dot = jnp.asarray(parameters()), dot_of(place)
    rays = _rays(numbers, dot)
    rng = np.random.default_rng(4)
    pulls = [jnp.asarray(rng.normal(size=a.shape)) for a in jax.tree.leaves(rays.spot)]

    spot, found = _led_back(numbers, dot, Spot(*pulls))
    # Rays that lead the way are evenly lit.
    lit = spot.weight / rays.spot.weight
    wanted = np.einsum("ri,rip->p", pulls[0], rays.landing_slopes_mm)
    wanted[TINY.pupil_parameters] += (pulls[1] * lit) @ rays.weight_slopes
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)


def test_single_precision_stays_single():
    """As the fit asks for most of its rays; nothing in between may promote them."""

    def single(tree):
        whole = jax.tree.map(jnp.asarray, tree)
        floats = eqx.filter(whole, eqx.is_inexact_array)
        cast = jax.tree.map(lambda a: a.astype(jnp.float32), floats)
        return eqx.combine(cast, whole)

    numbers, dot, colour, scale = single((parameters(), dot_of(PLACES[1]), GREY, SCALE))
    # The dtypes alone: nothing needs to be compiled for them.
    rays = jax.eval_shape(
        lambda *given: rays_alone(*given, TINY, scale, POINTS), numbers, dot, colour
    )
    assert {leaf.dtype for leaf in jax.tree.leaves(rays)} == {jnp.dtype("float32")}


def test_out_of_focus_light_is_an_oval():
    """Of a perfect lens that is sharp along both axes at one distance."""
    numbers = np.zeros(TINY.size)
    numbers[TINY.blocks["defocus"]] = 0.5
    numbers[TINY.blocks["rim_radius"]] = [3.0, 0.0, 3.0, 0.0]
    dot = dot_of((0.0, 0.0))
    sections = Sections(jnp.array([1.0, 0.0]), dot.sections.per_defocus)
    # Stopped down: at the rim of a wide stop the sensor's defocus is more than linear.
    dot = dot._replace(
        vergence=dot.reference, sections=sections, stop_radius=jnp.asarray(0.2)
    )
    spot = _rays(jnp.asarray(numbers), dot).spot
    width, height = np.ptp(np.asarray(spot.landing_mm), axis=0)
    np.testing.assert_allclose(height / width, SQUEEZE**2, rtol=0.04)


def squeezed(dot_data, layout: Layout):
    """The same photographs, had they been made through cylinders."""
    dots = dot_data.dots
    count = len(dots.group)
    sections = Sections(np.tile([1.0, 0.0], (count, 1)), np.full(count, PER_DEFOCUS))
    oval = np.tile(np.diag([0.01, 0.02]), (count, 1, 1))
    dots = dots._replace(sections=sections, sampled_ellipse_mm=oval)
    return replace(dot_data, dots=dots), layout


SHOT = photographed(Seidel(), [Shot(0, 0)], rays=4000)


def test_a_spherical_lens_has_none_of_it():
    assert "astigmatic_offset" not in LAYOUT.blocks
    names = {f.name for f in candidate_term_groups(SHOT, LAYOUT, np.zeros(1))}
    assert not {n for n in names if "cylinder" in n or n == "astigmatic_offset"}


def test_what_all_groups_say_together_is_said_by_one_of_them_only():
    """Constant astigmatism is the sum of all `beyond`; it stays fixed."""
    dot_data, layout = squeezed(SHOT, TINY)
    term_groups = candidate_term_groups(dot_data, layout, np.zeros(1))
    assert {"astigmatic_offset", "cylinders_third_order"} <= {
        f.name for f in term_groups
    }
    deviation = deviation_of(term_groups, layout, FINE)
    constant = TERMS.index(two_mirror_terms(1)[0])
    assert deviation[layout.blocks["coefficients"]][constant] == 0
    assert (deviation[layout.blocks["astigmatic_offset"]] > 0).tolist() == [True, False]
    kept = deviation[layout.blocks["coefficients"]] > 0
    assert kept.sum() == len(TERMS) - 2  # nor the constant of focus


def test_the_size_of_a_defocus_is_that_along_y():
    """Of a disc along y that is narrower along x, the mean was measured."""
    dot_data, _ = squeezed(SHOT, TINY)
    narrow = SQUEEZE**-2
    wanted = dot_data.diameter_mm**2 / 4 * (1 + narrow**2) / 2
    hole = 4 * dot_aperture_variance_mm2(dot_data.dots)
    diameter = 2 * np.sqrt(wanted + hole)
    oval = replace(dot_data, diameter_mm=diameter)
    nothing = jax.tree.map(
        np.zeros_like, (SHOT.dots.sampled_ellipse_mm, SHOT.dots.variance_mm2)
    )
    without = SHOT.dots._replace(sampled_ellipse_mm=nothing[0], variance_mm2=nothing[1])
    round_ = replace(SHOT, dots=without)
    np.testing.assert_allclose(defocus_size_mm(oval), defocus_size_mm(round_))

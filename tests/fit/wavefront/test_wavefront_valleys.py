"""Valleys of the misfit: a lens and its mirror image, and which valleys stay open."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import LAYOUT, SCALE, dots_at

from lensfit.fit.wavefront.parameters import mirrored
from lensfit.fit.wavefront.rays import Colour, polar_landings
from lensfit.fit.wavefront.valleys import Valley, sign_is_told, still_open

BLOCKS = LAYOUT.blocks
ONE_COLOUR = Colour(jnp.zeros(1), jnp.zeros((1, 2)))
DEFOCUS = BLOCKS["defocus"]


def some_lens():
    """Everything that a mirror could turn is in use."""
    found = np.zeros(LAYOUT.size)
    generator = np.random.default_rng(3)
    found[BLOCKS["coefficients"]] = generator.normal(0, 5, len(LAYOUT.terms))
    found[DEFOCUS] = 0.3
    found[BLOCKS["rim_shift"]] = [0.5, 0.1, -0.6, 0.0]
    found[BLOCKS["rim_radius"]] = [1.05, 0.0, 1.1, 0.0]
    found[BLOCKS["stop_shift"]] = [0.05, -0.02]
    found[BLOCKS["iris"]] = [0.02, 0.3, 0.2]
    return found


def landings_mm(parameters, place):
    """On spokes of which each has an opposite one."""
    dots = dots_at(np.array([place]), 0, 0, 0.01)
    dot = jax.tree.map(lambda a: jnp.asarray(a[0]), dots)
    seen = jnp.asarray(parameters), dot, ONE_COLOUR, LAYOUT, SCALE
    return np.asarray(polar_landings(*seen, (3, 8))[0][0])


@pytest.mark.parametrize(("place", "within"), [((0.0, 0.0), 1e-12), ((9.0, -5.0), 0.1)])
def test_a_mirrored_lens_sends_every_ray_where_the_opposite_one_went(place, within):
    """Off the axis oblique cones tell the two apart, by a little."""
    lens = some_lens()
    here = landings_mm(lens, place)
    there = landings_mm(mirrored(lens, LAYOUT), place)
    apart = np.linalg.norm(here[:, None] - there[None], axis=-1).min(1)
    assert apart.max() <= within * np.ptp(here)
    assert not np.allclose(here, there)


def test_the_mirror_image_of_the_mirror_image_is_the_lens():
    lens = some_lens()
    twice = mirrored(mirrored(lens, LAYOUT), LAYOUT)
    twice[BLOCKS["iris"].start + 1] -= 2 * np.pi
    np.testing.assert_allclose(twice, lens, atol=1e-12)


def at(pattern, cost, defocus_mm):
    parameters = np.zeros(LAYOUT.size)
    parameters[DEFOCUS] = defocus_mm
    return Valley(pattern, SimpleNamespace(layout=LAYOUT, parameters=parameters), cost)


def test_each_place_stays_open_once_and_no_hopeless_one():
    near, same, other = at(0, 1.0, 0.50), at(0, 1.01, 0.51), at(0, 1.3, -0.4)
    third, hopeless = at(0, 1.4, 0.1), at(0, 1.6, 0.9)
    mirror = at(1, 1.45, -0.5)
    found = [hopeless, third, other, same, near, mirror]
    assert still_open(found, 1.5, 2) == [near, other, mirror]


@pytest.mark.parametrize(("cost", "told"), [(1.05, False), (1.2, True)])
def test_a_sign_is_told_where_the_other_one_explains_clearly_less(cost, told):
    best, like_it = at(0, 1.0, 0.5), at(0, 1.01, 0.2)
    assert sign_is_told([at(1, cost, -0.5), best, like_it]) is told
    assert sign_is_told([best, like_it])

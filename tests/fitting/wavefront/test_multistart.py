"""Candidates: a lens and its mirror image, and which candidates stay open."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import GREY, LAYOUT, SCALE, dots_at

from lensfit.errors import FitError
from lensfit.fitting.wavefront import multistart
from lensfit.fitting.wavefront.light_centroid import polar_landings
from lensfit.fitting.wavefront.multistart import (
    Candidate,
    is_side_determined,
    leading_candidates,
    open_candidates,
    rejected_candidates,
    runs_against_statements,
)
from lensfit.fitting.wavefront.parameters import mirror_through_focus

BLOCKS = LAYOUT.blocks
DEFOCUS = BLOCKS["defocus"]


def some_lens():
    """Every mode, both rims and the stop are in use."""
    found = np.zeros(LAYOUT.size)
    generator = np.random.default_rng(3)
    found[BLOCKS["coefficients"]] = generator.normal(0, 5, len(LAYOUT.terms))
    found[DEFOCUS] = 0.3
    found[BLOCKS["rim_shift"]] = [0.5, 0.1, -0.6, 0.0]
    found[BLOCKS["rim_radius"]] = [1.05, 0.0, 1.1, 0.0]
    found[BLOCKS["stop_shift"]] = [0.05, -0.02]
    return found


def landings_mm(parameters, place):
    """On spokes of which each has an opposite one."""
    dots = dots_at(np.array([place]), 0, 0, 0.01)
    dot = jax.tree.map(lambda a: jnp.asarray(a[0]), dots)
    seen = jnp.asarray(parameters), dot, GREY, LAYOUT, SCALE
    return np.asarray(_landings(*seen, (3, 8))[0][0])


_landings = jax.jit(polar_landings, static_argnums=(3, 5))


@pytest.mark.parametrize(("place", "within"), [((0.0, 0.0), 1e-12), ((9.0, -5.0), 0.1)])
def test_a_mirrored_lens_sends_every_ray_where_the_opposite_one_went(place, within):
    """Off the axis oblique cones tell the two apart, by a little."""
    lens = some_lens()
    here = landings_mm(lens, place)
    there = landings_mm(mirror_through_focus(lens, LAYOUT), place)
    apart = np.linalg.norm(here[:, None] - there[None], axis=-1).min(1)
    assert apart.max() <= within * np.ptp(here)
    assert not np.allclose(here, there)


def test_the_mirror_image_of_the_mirror_image_is_the_lens():
    lens = some_lens()
    twice = mirror_through_focus(mirror_through_focus(lens, LAYOUT), LAYOUT)
    twice[BLOCKS["iris"].start + 1] -= 2 * np.pi
    np.testing.assert_allclose(twice, lens, atol=1e-12)


def at(cost, *defocus_mm, defocus_misfit_mm=0.0, dot_data=None):
    parameters = np.zeros(LAYOUT.size)
    parameters[DEFOCUS][: len(defocus_mm)] = defocus_mm
    stage = SimpleNamespace(layout=LAYOUT, parameters=parameters, dot_data=dot_data)
    return Candidate(stage, cost, defocus_misfit_mm)


def test_each_place_stays_open_once_and_no_hopeless_one():
    near, same, other = at(1.0, 0.5, 0.4), at(1.01, 0.51, 0.4), at(1.3, 0.2, 0.1)
    hopeless = at(1.6, 0.9, 0.8)
    assert open_candidates([hopeless, other, same, near], 1.5, 3) == [near, other]


def test_statements_rank_what_the_photographs_leave_open():
    best, as_good = (
        at(1.0, 0.5, defocus_misfit_mm=0.4),
        at(1.05, 0.2, defocus_misfit_mm=0.1),
    )
    worse = at(1.3, 0.1, defocus_misfit_mm=0.0)
    assert open_candidates([best, as_good, worse], 1.5, 2) == [as_good, best]
    assert open_candidates([best, worse], 1.5, 1) == [best]
    # Of those that explain clearly less, the deeper ones go on, whatever was stated.
    less = at(1.2, 0.35, defocus_misfit_mm=0.9)
    assert open_candidates([worse, less, best], 1.5, 2) == [best, less]


def test_the_best_one_across_focus_is_kept_where_the_side_is_open():
    best, second, across = at(1.0, 0.5), at(1.05, 0.3), at(1.2, -0.5)
    found = [across, second, best]
    assert open_candidates(found, 1.5, 2, both_sides=True) == [best, across]
    assert open_candidates(found, 1.5, 2) == [best, second]
    assert open_candidates(found, 1.15, 2, both_sides=True) == [best, second]


def test_those_of_lowest_cost_lead_whatever_was_stated():
    best, next_best = at(1.0, 0.5, defocus_misfit_mm=0.4), at(1.005, 0.2)
    worse, across, far = at(1.02, 0.3), at(1.08, -0.5), at(1.3, -0.5)
    found = [worse, across, next_best, best]
    assert leading_candidates(found, 1.05, 2) == [best, next_best]
    assert leading_candidates(found, 1.01, 3) == [best, next_best]
    # The other side of focus stays open while its cost does not decide against it.
    assert leading_candidates(found, 1.01, 2, both_sides=True) == [best, across]
    assert leading_candidates(found, 1.01, 3, both_sides=True) == [
        best,
        next_best,
        across,
    ]
    assert leading_candidates([best, far], 1.01, 2, both_sides=True) == [best]


def test_starts_that_all_failed_are_told():
    with pytest.raises(FitError, match="shape of the dots"):
        open_candidates([at(np.inf, 0.3)], 1.5, 2)


@pytest.mark.parametrize(("cost", "told"), [(1.05, False), (1.2, True)])
def test_a_side_is_told_where_the_other_one_explains_clearly_less(cost, told):
    best, like_it = at(1.0, 0.5), at(1.01, 0.2)
    assert is_side_determined([at(cost, -0.5), best, like_it]) is told
    assert is_side_determined([best, like_it])
    # Takes in focus have no side.
    assert is_side_determined([at(1.0, 0.5, 0.01), at(1.01, 0.5, -0.01)])


def test_what_was_left_comes_by_depth_without_failures():
    best, second, third, failed = at(1.0, 0.5), at(2.0, 0.2), at(1.5, 0.1), at(np.inf)
    left = rejected_candidates([failed, second, best, third], [best])
    assert [one.cost for one in left] == [1.5, 2.0]


STATED_MM = np.array([0.0, 0.33, -0.31])


@pytest.mark.parametrize(
    ("found_mm", "against"),
    [
        ((0.0, 0.33, -0.31), False),
        ((0.5, 0.9, 0.3), False),  # all moved together
        ((0.0, 0.1, -0.6), False),
        ((0.0, -0.33, 0.31), True),
        ((0.0, 0.33, 0.2), True),
    ],
)
def test_takes_in_another_order_than_stated_run_against_it(
    monkeypatch, found_mm, against
):
    monkeypatch.setattr(multistart, "stated_defocus_mm", lambda _: STATED_MM)
    assert runs_against_statements(at(1.0, *found_mm).stage) == against


@pytest.mark.parametrize(
    ("found_mm", "against"), [(0.33, False), (0.1, False), (-0.1, False), (-0.4, True)]
)
def test_one_side_of_focus_found_on_the_other_runs_against_it(
    monkeypatch, found_mm, against
):
    one_alone = np.array([0.33, np.nan, np.nan])
    monkeypatch.setattr(multistart, "stated_defocus_mm", lambda _: one_alone)
    assert runs_against_statements(at(1.0, found_mm, 0.2, 0.3).stage) == against


def test_what_nobody_stated_runs_against_nothing(monkeypatch):
    silent = np.full(3, np.nan)
    monkeypatch.setattr(multistart, "stated_defocus_mm", lambda _: silent)
    assert not runs_against_statements(at(1.0, 0.1, 0.2, 0.3).stage)


@pytest.mark.parametrize(
    ("costs", "alike"),
    [
        ((62.9, 63.0, 62.4, 62.5), False),
        ((62.9, 63.0, 62.4, 62.5, 62.6), True),
        ((5.0, np.inf, 5.0, 5.0), True),
        ((np.inf,) * 4, False),
    ],
)
def test_three_starts_that_end_at_the_lowest_cost_agree(costs, alike):
    assert multistart.have_starts_agreed([at(cost, 0.1) for cost in costs]) is alike

"""Which term groups are selected, and the misfit of a take that is held out."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from drawn_lens import LAYOUT, PLACES_MM, Seidel, Shot, photographed

from lensfit.fitting.trial import Scores
from lensfit.fitting.wavefront import term_group_selection
from lensfit.fitting.wavefront.fit import _notes
from lensfit.fitting.wavefront.misfit import held_out_dots, held_out_take
from lensfit.fitting.wavefront.stages import (
    chi_squared,
    first_stage,
    recentre_patches,
    set_priors,
    solve_stage,
)
from lensfit.fitting.wavefront.term_group_selection import select_term_groups
from lensfit.fitting.wavefront.term_groups import (
    LAST,
    SEIDEL,
    candidate_term_groups,
    deviation_of,
    indices_of,
    terms_that_change_with_focus,
)
from lensfit.optics.terms import rotational_terms

LENS = Seidel(12.0, -9.0, 14.0, 8.0, defocus_mm=(0.15, -0.12))
SHOTS = [Shot(0, 0), Shot(1, 0), Shot(0, 1), Shot(1, 1)]
DEFOCUS = LAYOUT.blocks["defocus"]


def fitted(lens: Seidel, allowed=None):
    """Everything free, from a start without what decentring adds."""
    places = np.concatenate([PLACES_MM, -PLACES_MM[1:] + [1.0, 2.0]])
    dot_data = photographed(lens, SHOTS, places_mm=places, seed=3)
    start = replace(lens, constant_coma_um=0.0).parameters()
    term_groups = candidate_term_groups(dot_data, LAYOUT, start[DEFOCUS], allowed)
    stage = set_priors(
        first_stage(dot_data, LAYOUT, start), deviation_of(term_groups, LAYOUT, LAST)
    )
    return solve_stage(solve_stage(recentre_patches(stage), 8), 8), term_groups


@pytest.fixture(scope="module")
def centred():
    return fitted(LENS)


@pytest.fixture(scope="module")
def decentred():
    return fitted(replace(LENS, constant_coma_um=5.0))


@pytest.mark.slow
def test_decentring_that_is_there_is_kept(decentred):
    choice = select_term_groups(*decentred)
    assert "decentred_elements" in {
        term_group.name for term_group in choice.term_groups
    }
    term_decision = next(
        v for v in choice.term_decisions if v.name == "decentred_elements"
    )
    assert term_decision.kept
    assert term_decision.bic_gain > 100
    assert term_decision.held_out_gain > 0.05


MOVING = replace(LAYOUT, focus_terms=terms_that_change_with_focus(rotational_terms(3)))


def dots_at_two_focus_distances(near: Seidel, far: Seidel, rays: int):
    """One lens at the nearer, the other at the farther distance."""
    places = np.concatenate([PLACES_MM, -PLACES_MM[1:] + [1.0, 2.0]])
    parts = [
        photographed(
            lens, [Shot(k, 0), Shot(k, 1)], places_mm=places, seed=k, rays=rays
        )
        for k, lens in enumerate((near, far))
    ]
    arrays = "light", "valid", "clipped", "observed_mm", "diameter_mm", "read_noise"
    dots = jax.tree.map(lambda *a: np.concatenate(a), *(one.dots for one in parts))
    return replace(
        parts[0],
        photographs=parts[0].photographs + parts[1].photographs,
        dots=dots._replace(focus=np.where(dots.group == 0, 1.0, -1.0)),
        take=np.concatenate([parts[0].take, 2 + parts[1].take]),
        groups=parts[0].groups + parts[1].groups,
        **{n: np.concatenate([getattr(one, n) for one in parts]) for n in arrays},
    )


def at_two_focus_distances(near: Seidel, far: Seidel):
    """Fitted with terms that may change; both lenses start as their mean."""
    dot_data = dots_at_two_focus_distances(near, far, 1_000_000)
    start = np.zeros(MOVING.size)
    for name, where in LAYOUT.blocks.items():
        if name != "focus_change":
            start[MOVING.blocks[name]] = LENS.parameters()[where]
    begun = start[MOVING.blocks["defocus"]]
    term_groups = candidate_term_groups(dot_data, MOVING, begun)
    stage = set_priors(
        first_stage(dot_data, MOVING, start), deviation_of(term_groups, MOVING, LAST)
    )
    stage = solve_stage(recentre_patches(stage), 8)
    # As the last stage of a fit has them: with fewer rays in the matrix a solve stops
    # on its way along a long, flat minimum.
    stage = solve_stage(replace(stage, ray_groups=4))
    return solve_stage(solve_stage(stage)), term_groups


@pytest.mark.slow
def test_what_elements_that_move_change_is_measured():
    """Coma and spherical aberration differ from one focus distance to the other."""
    near, far = (
        replace(LENS, coma_um=LENS.coma_um + s, spherical_um=LENS.spherical_um - s)
        for s in (3.0, -3.0)
    )
    stage, term_groups = at_two_focus_distances(near, far)
    kept = {one.name for one in select_term_groups(stage, term_groups).term_groups}
    assert "change_with_focus" in kept
    change = stage.parameters[MOVING.blocks["focus_change"]]
    families = [term.family for term in MOVING.focus_terms]
    expected = {"coma 3": 3.0, "spherical 3": -3.0}
    wanted = [expected.get(family, 0.0) for family in families]
    np.testing.assert_allclose(change, wanted, atol=0.5)


@pytest.mark.slow
def test_of_a_lens_that_moves_as_a_whole_no_change_is_measured():
    """Less than a twentieth of what it has, if noise lets it in at all."""
    stage, _ = at_two_focus_distances(LENS, LENS)
    change = stage.parameters[MOVING.blocks["focus_change"]]
    assert np.abs(change).max() < 0.6


def test_two_focus_distances_may_show_a_change():
    """Of third order, and nothing else is free with it."""
    dot_data = dots_at_two_focus_distances(LENS, LENS, 2_000)
    term_groups = candidate_term_groups(dot_data, MOVING, np.zeros(2))
    (change,) = (one for one in term_groups if one.name == "change_with_focus")
    where = MOVING.blocks["focus_change"]
    assert change.indices == tuple(range(where.start, where.stop))
    assert change.optional
    assert min(change.deviation) > 0


def test_one_focus_distance_shows_no_change(centred):
    _, term_groups = centred
    assert "change_with_focus" not in {one.name for one in term_groups}


def test_a_gain_is_a_share_of_what_was_left_without_the_term(centred, monkeypatch):
    """Every number takes three quarters of the held-out sum of squares away."""

    def scores(indices) -> Scores:
        return Scores(1.0, -100.0 * len(indices), np.array([4.0 ** -len(indices)]))

    fake = SimpleNamespace(scores=scores)
    monkeypatch.setattr(term_group_selection, "trial_of", lambda *_: fake)
    stage, term_groups = centred
    numbers = {f.name: len(indices_of((f,))) for f in term_groups}
    term_decisions = select_term_groups(stage, term_groups).term_decisions
    assert term_decisions
    for term_decision in term_decisions:
        expected = 1 - 4.0 ** -numbers[term_decision.name]
        assert term_decision.held_out_gain == pytest.approx(expected, rel=1e-12)


def test_a_centred_lens_is_left_centred(centred):
    choice = select_term_groups(*centred)
    names = [term_group.name for term_group in choice.term_groups]
    assert names == ["defocus", "third_order", "rims", "pupil_coma", "blades"]
    assert not any(term_decision.kept for term_decision in choice.term_decisions)
    assert {v.name for v in choice.term_decisions} >= {
        "decentred_elements",
        "exit_pupil",
    }


def test_a_group_that_is_not_listed_is_tried_too(centred):
    stage, term_groups = centred
    names = {"decentred_elements": "a_term_of_tomorrow"}
    named = tuple(replace(f, name=names.get(f.name, f.name)) for f in term_groups)
    decisions = {v.name: v for v in select_term_groups(stage, named).term_decisions}
    assert not decisions["a_term_of_tomorrow"].kept


def test_what_is_refined_stays(decentred):
    """Nobody asks for the exit pupil here; as the lower term of the series that ends
    with what decentred elements do, which is asked for, it stays all the same."""
    stage, term_groups = decentred
    series = {"exit_pupil": "axial_colour", "decentred_elements": "axial_colour_curved"}
    named = tuple(replace(f, name=series.get(f.name, f.name)) for f in term_groups)
    choice = select_term_groups(stage, named)
    assert set(series.values()) <= {
        term_group.name for term_group in choice.term_groups
    }
    of_name = {
        term_decision.name: term_decision for term_decision in choice.term_decisions
    }
    assert of_name["axial_colour"].kept
    assert "refine" in of_name["axial_colour"].reason
    assert "refine" not in of_name["axial_colour_curved"].reason


def test_a_lens_of_third_order_may_be_asked_for(centred):
    stage, term_groups = fitted(replace(LENS, constant_coma_um=5.0), SEIDEL)
    assert {term_group.name for term_group in term_groups} == SEIDEL
    choice = select_term_groups(stage, term_groups)
    assert (choice.term_groups, choice.term_decisions) == (term_groups, ())
    fixed = np.setdiff1d(np.arange(LAYOUT.size), indices_of(term_groups))
    np.testing.assert_array_equal(stage.parameters[fixed], stage.mean[fixed])
    whole, _ = centred
    assert chi_squared(stage) > 2 * chi_squared(whole)


def test_a_take_left_out_is_predicted_as_a_refit_would(centred):
    """In retrospect, against a fit that really has not seen it."""
    stage, _ = centred
    term_groups = _determined(centred)
    stage = set_priors(stage, deviation_of(term_groups, LAYOUT, LAST))
    stage = solve_stage(solve_stage(stage, 8), 1)
    take = 3
    mine = stage.dot_data.take == take
    told = held_out_take(stage, term_groups, take)
    blind = replace(stage, weight=stage.weight * ~mine[:, None, None, None])
    without = solve_stage(solve_stage(blind, 8), 8)
    again = solve_stage(replace(without, weight=stage.weight), 1)
    left = [2 * take, 2 * take + 1]
    now, then = (s.equations.chi_squared[left].sum() for s in (stage, again))
    assert told is not None
    assert 1.0 < told < 1.3
    assert told == pytest.approx(np.sqrt(then / now), rel=0.05)


def _determined(centred):
    _, term_groups = centred
    return tuple(f for f in term_groups if f.name in ("defocus", "third_order"))


def test_a_take_alone_in_its_group_keeps_its_own_defocus(centred):
    """Nobody else could know it: it is taken as known, and the rest predicts."""
    stage, term_groups = centred
    group = np.where(stage.dot_data.take == 3, 2, stage.dot_data.dots.group)
    dots = stage.dot_data.dots._replace(group=group)
    own = replace(stage, dot_data=replace(stage.dot_data, dots=dots))
    third = DEFOCUS.start + 2
    wide = tuple(
        replace(f, indices=(*f.indices, third), deviation=(*f.deviation, 9.0))
        if f.name == "defocus"
        else f
        for f in term_groups
    )
    own = replace(own, deviation=deviation_of(wide, LAYOUT, LAST))
    told = held_out_take(own, wide, 3)
    assert told is not None
    assert 0.9 < told < 2
    assert third in indices_of(wide)


def test_dots_left_out_are_predicted_nearly_as_well(centred):
    stage, term_groups = centred
    factor = held_out_dots(stage, _determined(centred))
    assert 0.99 < factor < 1.2
    assert held_out_dots(stage, term_groups) > factor


@pytest.mark.parametrize(
    ("known", "converged", "misfit", "said"),
    [
        (True, True, 0.03, []),
        (True, True, 0.5, ["misses the dots' shape by 50 %"]),
        (True, True, float("nan"), ["misses"]),
        (False, False, 0.03, ["on which side of focus", "did not converge"]),
    ],
)
def test_a_fit_says_what_it_did_not_reach(known, converged, misfit, said):
    notes = _notes(known, converged, misfit, against=False, mirrored=False)
    assert len(notes) == len(said)
    assert all(part in note for part, note in zip(said, notes, strict=True))


def test_a_fit_against_what_was_stated_says_so_and_asks_for_no_statement():
    (note,) = _notes(False, True, 0.03, against=True, mirrored=False)
    assert "on other sides of focus than focus_distance_mm" in note


def test_a_fit_on_the_other_side_of_focus_asks_whether_distances_were_swapped():
    (note,) = _notes(False, True, 0.15, against=True, mirrored=True)
    assert "near and far takes swapped" in note

"""What the photographs ask for, and what the fit would do without one of them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drawn_lens import LAYOUT, PLACES_MM, Seidel, Shot, photographed

from lensfit.fitting.trial import Scores
from lensfit.fitting.wavefront.fit import _notes
from lensfit.fitting.wavefront.misfit import held_out_dots, held_out_take
from lensfit.fitting.wavefront.stages import (
    chi_squared,
    first_stage,
    freed,
    settled,
    solved,
)
from lensfit.fitting.wavefront.term_group_selection import choose
from lensfit.fitting.wavefront.term_groups import (
    LAST,
    SEIDEL,
    deviation_of,
    families_of,
    indices_of,
)

LENS = Seidel(12.0, -9.0, 14.0, 8.0, defocus_mm=(0.15, -0.12))
SHOTS = [Shot(0, 0), Shot(1, 0), Shot(0, 1), Shot(1, 1)]
DEFOCUS = LAYOUT.blocks["defocus"]


def fitted(lens: Seidel, allowed=None):
    """Everything free, from a start without what decentring adds."""
    places = np.concatenate([PLACES_MM, -PLACES_MM[1:] + [1.0, 2.0]])
    gathered = photographed(lens, SHOTS, places_mm=places, seed=3)
    start = replace(lens, constant_coma_um=0.0).parameters()
    families = families_of(gathered, LAYOUT, start[DEFOCUS], allowed)
    stage = freed(
        first_stage(gathered, LAYOUT, start), deviation_of(families, LAYOUT, LAST)
    )
    return solved(solved(settled(stage), 8), 8), families


@pytest.fixture(scope="module")
def centred():
    return fitted(LENS)


def test_decentring_that_is_there_is_kept():
    choice = choose(*fitted(replace(LENS, constant_coma_um=5.0)))
    assert "decentred_elements" in {family.name for family in choice.families}
    verdict = next(v for v in choice.verdicts if v.name == "decentred_elements")
    assert verdict.kept
    assert verdict.bic_gain > 100
    assert verdict.held_out_gain > 0.05


def test_a_gain_is_a_share_of_what_was_left_without_the_term(centred, monkeypatch):
    """Every number takes three quarters of the held-out sum of squares away."""

    def scores(indices) -> Scores:
        return Scores(1.0, -100.0 * len(indices), 4.0 ** -len(indices))

    fake = SimpleNamespace(scores=scores)
    monkeypatch.setattr(evidence, "trial_of", lambda *_: fake)
    stage, families = centred
    numbers = {f.name: len(indices_of((f,))) for f in families}
    verdicts = choose(stage, families).verdicts
    assert verdicts
    for verdict in verdicts:
        expected = 1 - 4.0 ** -numbers[verdict.name]
        assert verdict.held_out_gain == pytest.approx(expected, rel=1e-12)


def test_a_centred_lens_is_left_centred(centred):
    choice = choose(*centred)
    names = [family.name for family in choice.families]
    assert names == ["defocus", "third_order", "rims", "pupil_coma", "blades"]
    assert not any(verdict.kept for verdict in choice.verdicts)
    assert {v.name for v in choice.verdicts} >= {"decentred_elements", "exit_pupil"}


def test_what_is_refined_stays():
    """Nobody asks for the exit pupil here; as the lower term of the series that ends
    with what decentred elements do, which is asked for, it stays all the same."""
    stage, families = fitted(replace(LENS, constant_coma_um=5.0))
    series = {"exit_pupil": "axial_colour", "decentred_elements": "axial_colour_curved"}
    named = tuple(replace(f, name=series.get(f.name, f.name)) for f in families)
    choice = choose(stage, named)
    assert set(series.values()) <= {family.name for family in choice.families}
    of_name = {verdict.name: verdict for verdict in choice.verdicts}
    assert of_name["axial_colour"].kept
    assert "refine" in of_name["axial_colour"].reason
    assert "refine" not in of_name["axial_colour_curved"].reason


def test_a_lens_of_third_order_may_be_asked_for(centred):
    stage, families = fitted(replace(LENS, constant_coma_um=5.0), SEIDEL)
    assert {family.name for family in families} == SEIDEL
    choice = choose(stage, families)
    assert (choice.families, choice.verdicts) == (families, ())
    fixed = np.setdiff1d(np.arange(LAYOUT.size), indices_of(families))
    np.testing.assert_array_equal(stage.parameters[fixed], stage.mean[fixed])
    whole, _ = centred
    assert chi_squared(stage) > 2 * chi_squared(whole)


def test_a_take_left_out_is_predicted_as_a_refit_would(centred):
    """In retrospect, against a fit that really has not seen it."""
    stage, _ = centred
    families = _determined(centred)
    stage = freed(stage, deviation_of(families, LAYOUT, LAST))
    stage = solved(solved(stage, 8), 1)
    take = 3
    mine = stage.gathered.take == take
    told = held_out_take(stage, families, take)
    blind = replace(stage, weight=stage.weight * ~mine[:, None, None, None])
    without = solved(solved(blind, 8), 8)
    again = solved(replace(without, weight=stage.weight), 1)
    left = [2 * take, 2 * take + 1]
    now, then = (s.equations.chi_squared[left].sum() for s in (stage, again))
    assert told is not None
    assert 1.0 < told < 1.3
    assert told == pytest.approx(np.sqrt(then / now), rel=0.05)


def _determined(centred):
    _, families = centred
    return tuple(f for f in families if f.name in ("defocus", "third_order"))


def test_a_take_alone_in_its_group_keeps_its_own_defocus(centred):
    """Nobody else could know it: it is taken as known, and the rest predicts."""
    stage, families = centred
    group = np.where(stage.gathered.take == 3, 2, stage.gathered.dots.group)
    dots = stage.gathered.dots._replace(group=group)
    own = replace(stage, gathered=replace(stage.gathered, dots=dots))
    third = DEFOCUS.start + 2
    wide = tuple(
        replace(f, indices=(*f.indices, third), deviation=(*f.deviation, 9.0))
        if f.name == "defocus"
        else f
        for f in families
    )
    own = replace(own, deviation=deviation_of(wide, LAYOUT, LAST))
    told = held_out_take(own, wide, 3)
    assert told is not None
    assert 0.9 < told < 2
    assert third in indices_of(wide)


def test_dots_left_out_are_predicted_nearly_as_well(centred):
    stage, families = centred
    factor = held_out_dots(stage, _determined(centred))
    assert 0.99 < factor < 1.2
    assert held_out_dots(stage, families) > factor


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

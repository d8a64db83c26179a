"""Residuals of the fit's own priors, as contradictions of a verdict."""

from types import SimpleNamespace

import numpy as np
import pytest

from lensfit.fitting.statements import Statement
from lensfit.workflow.statements.contradiction import Contradiction
from lensfit.workflow.statements.contradictions import contradictions_of_fit
from lensfit.workflow.statements.fitted_statements import contradicted_by_fit


def state(*statements: Statement, focus_mm: float = 1500.0, anamorphic: bool = False):
    """What is read of a fitted state."""
    names = {one.where for one in statements if one.where} or {"any.png"}
    takes = [
        SimpleNamespace(name=name, target="dots", anamorphic=anamorphic)
        for name in names
    ]
    return SimpleNamespace(
        focal_length_mm=50.0,
        focus_distance_mm=focus_mm,
        geometry=SimpleNamespace(takes=takes, statements=statements),
    )


def focal(fitted: float) -> Statement:
    return Statement("focal_length", "", 50.0, 1.5, fitted)


def distance(name: str, fitted: float, stated: float = 2000.0) -> Statement:
    return Statement("target_distance", name, stated, 10.0, fitted)


def test_statements_within_three_widths_are_left_alone():
    right = state(focal(54.0), distance("a.png", 2029.0), distance("b.png", 1975.0))
    assert list(contradicted_by_fit([right], [])) == []


def test_a_focal_length_is_named_with_what_was_fitted():
    """Of several states the one in the middle: one of them may be ill."""
    states = [state(focal(f), focus_mm=d) for f, d in ((43.0, 1e3), (44.0, 2e3))]
    states.append(state(focal(50.0), focus_mm=3e3))
    (found,) = contradicted_by_fit(states, [])
    assert found.kind == "focal_length"
    assert (found.stated, found.agrees_with) == (50.0, 44.0)
    assert "4 standard deviations away" in found.text
    assert found.limit == "undistortion"


def test_a_focal_length_that_focusing_changes_is_as_engraved_at_infinity():
    """As of a zoom that focuses by its front group."""
    zoom = [
        state(focal(50.0 * ratio), focus_mm=mm)
        for ratio, mm in ((1.107, 2870.0), (1.159, 2050.0), (1.066, 4740.0))
    ]
    assert list(contradicted_by_fit(zoom, [])) == []
    wrong = [
        state(focal(50.0 * ratio), focus_mm=mm)
        for ratio, mm in ((1.25, 2870.0), (1.252, 2050.0), (1.249, 4740.0))
    ]
    (found,) = contradicted_by_fit(wrong, [])
    assert found.agrees_with == pytest.approx(62.5, abs=0.2)


def test_which_focal_length_of_an_anamorphic_lens_was_stated_is_left_to_notes():
    assert list(contradicted_by_fit([state(focal(26.0), anamorphic=True)], [])) == []


def test_a_distance_that_views_share_was_measured_once():
    """Scatter about the right one is none of the tape measure's."""
    scattered = state(distance("a.png", 2035.0), distance("b.png", 1967.0))
    assert list(contradicted_by_fit([scattered], [])) == []
    wrong = state(distance("a.png", 2075.0), distance("b.png", 2045.0))
    (found,) = contradicted_by_fit([wrong], [])
    assert found.agrees_with == pytest.approx(2060.0)
    assert found.images == ("a.png", "b.png")


def test_one_view_before_which_the_chart_was_moved_is_named():
    views = [distance(f"{k}.png", 2002.0) for k in range(6)]
    (found,) = contradicted_by_fit([state(*views, distance("moved.png", 2090.0))], [])
    assert found.images == ("moved.png",)
    assert "target_distance_mm of moved is stated as 2000 mm" in found.text


def pupil(fitted_mm: float) -> Statement:
    return Statement("usual_entrance_pupil", "", 90.0, 95.0, fitted_mm)


@pytest.mark.parametrize("fitted_mm", [230.0, -52.0])
def test_a_pupil_where_published_designs_have_it_is_left_alone(fitted_mm):
    """Within a width and a half of 95 mm."""
    right = state(pupil(fitted_mm), distance("a.png", 2000.0))
    assert list(contradicted_by_fit([right], [])) == []


def test_a_tape_held_at_the_front_of_the_lens_puts_the_pupil_behind_the_sensor():
    wrong = state(pupil(-60.0), distance("a.png", 2001.0), distance("b.png", 1999.0))
    (found,) = contradicted_by_fit([wrong], [])
    assert found.kind == "target_distance"
    assert found.agrees_with == pytest.approx(2150.0)
    assert "60 mm behind the sensor" in found.text
    assert "from the sensor's mark" in found.remedy
    assert found.images == ("a.png", "b.png")
    assert found.limit == "undistortion"


def test_a_pupil_that_no_stated_distance_places_contradicts_none():
    assert list(contradicted_by_fit([state(pupil(-150.0))], [])) == []


def test_where_a_cause_is_known_its_consequences_are_not_told_again():
    known = Contradiction("pitch", "undistortion", "pitch", "check it")
    wrong = state(focal(60.0))
    assert list(contradicted_by_fit([wrong], [known])) == []
    light = Contradiction("encoding", "undistortion", "encoding", "state it")
    assert len(list(contradicted_by_fit([wrong], [light]))) == 1


@pytest.mark.parametrize(("undetermined", "accused"), [((), 1), (("stop_ratios",), 0)])
def test_an_f_number_is_contradicted_by_dots_that_show_it(undetermined, accused):
    """What the shape of dots leaves undetermined contradicts nothing."""
    wavefront = SimpleNamespace(
        fits_stated_side=True,
        mirrored=False,
        has=lambda name: name == "stop_ratios",
        undetermined_term_groups=undetermined,
        dot_data=SimpleNamespace(f_numbers=(4.0, 8.0)),
        stage=SimpleNamespace(
            layout=SimpleNamespace(blocks={"stop_ratio": slice(0, 1)}),
            parameters=np.array([-0.3]),
        ),
    )
    fitted = SimpleNamespace(states=[], wavefronts={50.0: wavefront})
    found = [*contradictions_of_fit([], fitted)]
    assert [one.kind for one in found] == ["f_number"] * accused

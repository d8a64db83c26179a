"""The statement that is wrong is named with its value; right shoots are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoots import (
    drawn,
    drawn_from_every_class,
    right_shoot,
    stated_otherwise,
)

from lensfit.fitting.chart_view import View
from lensfit.workflow.statements.contradictions import contradictions_of_views
from lensfit.workflow.statements.released_statements import contradicted_statements

FEW = range(2)
SEEDS = range(6)
MANY = range(60)


def seeds(slow: range):
    """Few shoots in every run of the tests, the others where there is time."""
    return pytest.mark.parametrize(
        "seeds", [FEW, pytest.param(slow, marks=pytest.mark.slow)], ids=["few", "many"]
    )


def shoot_of(seed: int):
    rng = np.random.default_rng(seed)
    truth = drawn(rng)
    return truth, right_shoot(truth, rng)


@seeds(MANY)
def test_no_right_shoot_is_accused(seeds):
    accused = {}
    for seed in seeds:
        found = contradictions_of_views(shoot_of(seed)[1])
        if found:
            accused[seed] = [one.text for one in found]
    assert accused == {}


@seeds(MANY)
def test_no_class_of_lens_is_taken_for_a_wrong_statement(seeds):
    accused = {}
    for seed in seeds:
        rng = np.random.default_rng(seed)
        found = contradictions_of_views(right_shoot(drawn_from_every_class(rng), rng))
        if found:
            accused[seed] = [one.text for one in found]
    assert len(accused) <= 0.05 * len(seeds), accused


@seeds(SEEDS)
@pytest.mark.parametrize("factor", [1.1, 0.9])
def test_a_wrong_pitch_beside_a_right_one_is_named(factor, seeds):
    named = 0
    for seed in seeds:
        _, takes = shoot_of(seed)
        wrong = stated_otherwise(
            takes, "dots", pitch_mm=lambda t: (factor * t.pitch_mm[0],) * 2
        )
        found = list(contradicted_statements(wrong))
        assert found, seed
        right = found[0].kind == "pitch" and '"dots"' in str(found[0].statement)
        named += right or ('"lines"' in found[0].text)
        if right:
            assert found[0].agrees_with == pytest.approx(takes[0].pitch_mm[0], rel=0.02)
    # Of two pitches that disagree, distances must say which is wrong.
    assert named >= 0.8 * len(seeds)


def squeezed(takes: list[View], squeeze: float = 1.8) -> list[View]:
    """The same through an anamorphic lens, whose true squeeze is a little more."""
    result = []
    for take in takes:
        seen = take.observations
        middle = np.asarray(seen.image_size_px) / 2
        points = (seen.points_px - middle) / [1.01 * squeeze, 1.0] + middle
        seen = replace(seen, points_px=points)
        result.append(replace(take, observations=seen, squeeze=squeeze))
    return result


def test_statements_of_an_anamorphic_lens_are_judged_too():
    for seed in range(2):
        _, takes = shoot_of(seed)
        takes = squeezed(takes)
        assert list(contradicted_statements(takes)) == []
        wrong = stated_otherwise(
            takes, "dots", pitch_mm=lambda t: (1.1 * t.pitch_mm[0],) * 2
        )
        first, *_ = contradicted_statements(wrong)
        assert "pitch_mm" in first.text, (seed, first.text)


def test_one_view_at_another_zoom_setting_is_named():
    """The tilted one, whose distance nobody states."""
    _, takes = shoot_of(1)
    seen = takes[3].observations
    middle = np.asarray(seen.image_size_px) / 2
    larger = replace(seen, points_px=(seen.points_px - middle) * 1.2 + middle)
    wrong = [*takes[:3], replace(takes[3], observations=larger), takes[4]]
    first, *_ = contradicted_statements(wrong)
    assert first.kind == "lens_identity", first.text
    assert first.images == ("view_3.png",)


@seeds(range(3))
def test_two_views_at_another_zoom_setting_are_no_wrong_tape(seeds):
    """A tape that stood still is wrong alike for all views: it does not explain that
    two of them, a third of those with a stated distance, are larger."""
    for seed in seeds:
        truth, takes = shoot_of(seed)
        still = round(truth.distance_mm)
        takes = [replace(t, target_distance_mm=still) for t in (*takes[:3], takes[4])]
        wrong = []
        for k, take in enumerate(takes):
            seen = take.observations
            middle = np.asarray(seen.image_size_px) / 2
            points = (seen.points_px - middle) * (1.08 if k in (1, 2) else 1) + middle
            seen = replace(seen, points_px=points)
            wrong.append(replace(take, observations=seen))
        first, *_ = contradicted_statements(wrong)
        assert first.kind == "lens_identity", (seed, first.text)
        assert first.images == ("view_1.png", "view_2.png")


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.1, 1 / 25.4])
def test_a_tape_in_another_unit_is_named_for_all_views(factor):
    for seed in range(2):
        truth, takes = shoot_of(seed)
        short = round(factor * truth.distance_mm, 1)
        wrong = [replace(take, target_distance_mm=short) for take in takes[:3]]
        first, *_ = contradicted_statements(wrong)
        assert first.statement == "target_distance_mm of all views", first.text
        assert first.agrees_with == pytest.approx(truth.distance_mm, rel=0.15)


@pytest.mark.slow
def test_exchanged_pitches_are_named_as_such():
    for seed in range(2):
        _, takes = shoot_of(seed)
        pitches = {take.target: take.pitch_mm for take in takes}
        other = {"dots": pitches["lines"], "lines": pitches["dots"]}
        wrong = stated_otherwise(takes, pitch_mm=lambda t: other[t.target])  # noqa: B023
        first, *_ = contradicted_statements(wrong)
        assert first.kind == "pitch", (seed, first.text)
        assert "“dots” and “lines” are exchanged" in first.text, (seed, first.text)
        assert first.agrees_with == pitches["dots"][0]


@seeds(SEEDS)
@pytest.mark.parametrize("factor", [1.25, 0.8])
def test_a_wrong_focal_length_is_named_with_the_right_one(factor, seeds):
    """In at least five of six shoots; a long lens far from its target hides it."""
    named = 0
    for seed in seeds:
        truth, takes = shoot_of(seed)
        wrong = stated_otherwise(
            takes, focal_length_mm=lambda t: round(factor * t.focal_length_mm, 1)
        )
        for one in list(contradicted_statements(wrong))[:1]:
            assert one.kind == "focal_length", (seed, one.text)
            right = pytest.approx(truth.focal_length_mm, rel=0.06)
            assert one.agrees_with == right
            named += 1
    assert named >= len(seeds) - len(seeds) // 6


@pytest.mark.slow
@seeds(SEEDS)
def test_a_target_that_was_moved_is_named_with_its_place(seeds):
    """To a seventh: it is the only view of its focus distance, which breathes."""
    for seed in seeds:
        truth, takes = shoot_of(seed)
        wrong = list(takes)
        wrong[1:2] = stated_otherwise(
            takes[1:2], target_distance_mm=lambda t: 1.25 * t.target_distance_mm
        )
        found = list(contradicted_statements(wrong))
        assert found, seed
        assert found[0].kind == "target_distance", (seed, found[0].text)
        assert found[0].images == ("view_1.png",)
        assert found[0].agrees_with == pytest.approx(truth.distance_mm, rel=0.15)

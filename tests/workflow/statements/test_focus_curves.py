"""Widths of dots through focus against focus distances, of lenses drawn by chance."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoots import Truth, drawn, right_shoot

from lensfit.fitting.chart_view import View
from lensfit.workflow.statements.contradictions import contradictions_of_views
from lensfit.workflow.statements.focus_curves import focus_curves, focus_units

IN_FOCUS_PX = 2.0
SEEDS = range(4)
FEET_PER_METRE = 3.2808


def through_focus(seed: int, squeeze: float = 1.0) -> tuple[Truth, list[View]]:
    """Views at two f-numbers, as wide as discs of defocus behind the true pupil."""
    rng = np.random.default_rng(seed)
    truth = drawn(rng)
    takes = right_shoot(truth, rng)
    views = []
    for stop in (4.0, 8.0):
        for k, take in enumerate(takes[:3]):
            wide = replace(
                take,
                name=f"{stop:g}_{k}.png",
                f_number=stop,
                squeeze=squeeze,
                target_distance_mm=round(truth.distance_mm),
            )
            views.append(with_disc(wide, truth))
    return truth, views


def with_disc(take: View, truth: Truth) -> View:
    """Dots as wide as first-order optics has them: of both axes the rms."""
    f = truth.focal_length_mm
    assert take.focus_distance_mm is not None
    assert take.f_number is not None
    z, s = (mm - truth.pupil_mm for mm in (truth.distance_mm, take.focus_distance_mm))
    disc_mm = f**2 / take.f_number * (1 + f / s) * abs(1 / z - 1 / s)
    both = np.hypot(1.0, take.squeeze**-2) / np.sqrt(2)
    width = np.hypot(IN_FOCUS_PX, both * disc_mm / take.pixel_mm[0])
    seen = take.observations
    seen = replace(seen, diameter_px=np.full(len(seen), width))
    return replace(take, observations=seen)


def in_unit(takes: list[View], factor: float) -> list[View]:
    return [
        replace(take, focus_distance_mm=factor * (take.focus_distance_mm or np.nan))
        for take in takes
    ]


@pytest.mark.parametrize("squeeze", [1.0, 1.9])
def test_a_right_shoot_is_sharpest_where_it_is_stated(squeeze):
    for seed in SEEDS:
        _, takes = through_focus(seed, squeeze)
        curves = focus_curves(takes)
        assert curves
        for curve in curves:
            assert abs(curve.vertex_log) < 0.05
            assert abs(curve.widening_log) < 0.15
        assert list(focus_units(takes)) == []


@pytest.mark.slow
@pytest.mark.parametrize("squeeze", [1.0, 1.9])
@pytest.mark.parametrize(
    ("factor", "words"),
    [(FEET_PER_METRE, "feet"), (1 / FEET_PER_METRE, "metres"), (3.0, "of what")],
)
def test_focus_distances_in_another_unit_are_named(squeeze, factor, words):
    for seed in SEEDS:
        _, takes = through_focus(seed, squeeze)
        (found,) = focus_units(in_unit(takes, factor))
        assert found.statement == "focus_distance_mm"
        assert found.stated is not None
        assert found.agrees_with == pytest.approx(found.stated / factor, rel=0.1)
        if words != "of what":
            assert words in found.text


def test_another_unit_of_focus_is_named_before_what_follows_from_it():
    """The lens would breathe otherwise, which contradicts sizes and distances."""
    _, takes = through_focus(0)
    (found,) = contradictions_of_views(in_unit(takes, FEET_PER_METRE))
    assert found.kind == "side_of_focus"
    assert "as if feet were taken for metres" in found.text


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0])
def test_a_wrong_target_distance_or_f_number_is_no_wrong_unit_of_focus(factor):
    _, takes = through_focus(1)
    moved = [
        replace(take, target_distance_mm=factor * (take.target_distance_mm or np.nan))
        for take in takes
    ]
    assert list(focus_units(moved)) == []
    stopped = [replace(take, f_number=factor * (take.f_number or 0)) for take in takes]
    assert list(focus_units(stopped)) == []


def test_views_that_defocus_barely_widens_show_nothing():
    _, takes = through_focus(2)
    seen = [replace(t.observations, diameter_px=t.observations.diameter_px * 0 + 2)
            for t in takes]  # fmt: skip
    sharp = [replace(t, observations=s) for t, s in zip(takes, seen, strict=True)]
    assert focus_curves(sharp) == []
    assert focus_curves(takes[:2]) == []

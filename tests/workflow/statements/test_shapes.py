"""Photographs stretched, turned or of another size; right ones are left alone."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoots import SIZE_PX, drawn, right_shoot, stated_otherwise

from lensfit.workflow.statements.aspect_contradictions import (
    aspect_contradictions,
    log_stretch,
)
from lensfit.workflow.statements.contradictions import contradictions_of_views

SEEDS = range(8)


def right(seed: int = 1):
    rng = np.random.default_rng(seed)
    return right_shoot(drawn(rng), rng)


def scaled(take, across: float, down: float, name: str | None = None):
    """The photograph resampled to another number of pixels."""
    seen, factor = take.observations, np.array([across, down])
    size = tuple(round(n * f) for n, f in zip(SIZE_PX, factor, strict=True))
    seen = replace(seen, points_px=seen.points_px * factor, image_size_px=size)
    return replace(take, observations=seen, name=name or take.name)


@pytest.mark.parametrize("seed", SEEDS)
def test_right_shoots_are_square(seed: int):
    """Also tilted by 14 and -11 degrees, as one view of each is."""
    takes = right(seed)
    assert list(aspect_contradictions(takes)) == []
    assert abs(np.median([log_stretch(take) or 0.0 for take in takes])) < 0.02


@pytest.mark.parametrize("squeeze", [1.33, 1.8, 2.0])
def test_a_squeeze_that_nobody_stated_is_named_with_its_value(squeeze: float):
    """An anamorphic lens images squares narrower by its squeeze."""
    middle = np.array(SIZE_PX) / 2
    takes = []
    for take in right():
        seen = take.observations
        narrow = (seen.points_px - middle) / [squeeze, 1.0] + middle
        takes.append(replace(take, observations=replace(seen, points_px=narrow)))
    (found,) = aspect_contradictions(takes)
    assert found.statement == "anamorphic_squeeze"
    assert f"anamorphic_squeeze = {squeeze:.2f}" in found.text
    told = stated_otherwise(takes, squeeze=lambda _: squeeze)
    assert list(aspect_contradictions(told)) == []


def test_sides_of_the_sensor_and_of_the_pitch_are_told_apart():
    swapped = stated_otherwise(right(), sensor_size_mm=lambda t: t.sensor_size_mm[::-1])
    for views in (swapped, swapped[:1]):
        found = next(aspect_contradictions(views))
        assert found.statement == "sensor_width_mm"
        assert "look swapped" in found.text
    pitch = stated_otherwise(
        right(), "dots", pitch_mm=lambda t: (t.pitch_mm[0], 1.5 * t.pitch_mm[1])
    )
    (found,) = aspect_contradictions(pitch)
    assert found.statement == "pitch_mm"
    assert '"dots"' in found.text


def test_views_of_another_size_are_named_before_what_follows_from_them():
    takes = right()
    mixed = [scaled(takes[0], 0.75, 0.75, "small.png"), *takes[1:]]
    (found,) = contradictions_of_views(mixed)
    assert found.kind == "photograph_size"
    assert found.images == ("small.png",)
    assert "small.png is 900 x 675 px (scaled" in found.text
    assert found.text.endswith("the others 1200 x 900 px")
    alike = [scaled(take, 0.75, 0.75) for take in takes]
    assert list(aspect_contradictions(alike)) == []


def test_a_photograph_turned_by_a_quarter_is_said_to_be():
    takes = right()
    seen = takes[2].observations
    points = seen.points_px[:, ::-1] * [1.0, -1.0] + [0.0, SIZE_PX[0]]
    turned = replace(seen, points_px=points, image_size_px=SIZE_PX[::-1])
    (found,) = aspect_contradictions(
        [*takes[:2], replace(takes[2], observations=turned)]
    )
    assert "probably turned by a quarter" in found.text
    assert found.limit == "look"

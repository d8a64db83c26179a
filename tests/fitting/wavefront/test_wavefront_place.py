"""Marks move from where their light is to where their chief rays land."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drawn_lens import F_NUMBERS, LAYOUT, PLACES_MM, Seidel, Shot, photographed
from found_marks import found_marks

from lensfit.detect.observations import Observations
from lensfit.fitting.take import Take
from lensfit.fitting.wavefront.adjusted_wavefront import moving_together, placed
from lensfit.fitting.wavefront.centroid_biases import (
    moves_of_marks_mm,
    slight_moves_of_marks_mm,
)
from lensfit.fitting.wavefront.constrained_refit import undoing
from lensfit.fitting.wavefront.gather import Gathered
from lensfit.fitting.wavefront.stages import Stage, first_stage, freed, solved

LENS = Seidel(0.0, 0.0, 15.0, 5.0, defocus_mm=(0.1,), rims=((0.6, 1.1), (-0.5, 1.2)))
SENSOR_MM = (36.0, 40.0)
IMAGE_PX = (3600, 4000)
PIXEL_MM = 0.01
SHOTS = [Shot(0, 0, 1900.0), Shot(0, 1, 1900.0)]


def seen(points_mm: np.ndarray) -> Observations:
    """Centroids of all channels, and one more mark whose size is unknown."""
    points = np.concatenate([points_mm, [[1.0, 1.0]]]) / PIXEL_MM
    points = points + np.asarray(IMAGE_PX) / 2
    count = len(points)
    return found_marks(
        points,
        IMAGE_PX,
        channel_points_px=np.stack([points, points, points + 1.0]),
        channel_covariance_px2=np.full((3, count, 2, 2), 1e-4),
        flux=np.full((count, 1), 1.0),
        diameter_px=np.append(np.full(count - 1, 9.0), np.nan),
    )


def shot_lens() -> tuple[Stage, Gathered, np.ndarray]:
    """The true fit, all dots, and their centroids from where the chief rays land."""
    gathered = photographed(LENS, SHOTS, rays=2000)
    rng = np.random.default_rng(9)
    dragged, shown = [], []
    for k, shot in enumerate(SHOTS):
        radius = F_NUMBERS[0] / F_NUMBERS[shot.stop]
        mean = [
            LENS.landing_mm(
                LENS.opening(place / 20.0, radius, 100_000, rng), place, 0
            ).mean(0)
            for place in PLACES_MM
        ]
        dragged.append(np.array(mean))
        take = Take(
            f"take {k}", "grid", seen(PLACES_MM + mean), (40.0, 40.0), 8.0, 50.0,
            SENSOR_MM, F_NUMBERS[shot.stop], 1900.0, 2000.0,
        )  # fmt: skip
        marks = np.arange(len(PLACES_MM))
        shown.append(
            SimpleNamespace(
                take=take, cutouts=SimpleNamespace(marks=marks, mosaic=None)
            )
        )
    gathered = replace(gathered, shown=tuple(shown))
    return first_stage(gathered, LAYOUT, LENS.parameters()), gathered, np.array(dragged)


@pytest.fixture(scope="module")
def shot():
    return shot_lens()


def test_comatic_dots_move_to_their_chief_rays(shot):
    stage, gathered, dragged = shot
    takes = placed(stage, gathered)
    assert np.hypot(*dragged[0].T).max() > 0.4 * PIXEL_MM
    for take, shown in zip(takes, gathered.shown, strict=True):
        before, after = shown.take.observations, take.observations
        middle = np.asarray(IMAGE_PX) / 2
        found = (after.points_px[:-1] - middle) * PIXEL_MM
        np.testing.assert_allclose(found, PLACES_MM, atol=3e-4)
        moved = after.channel_points_px - before.channel_points_px
        np.testing.assert_allclose(moved[:, :-1], np.stack([moved[1, :-1]] * 3))
        assert take.chief_rays
        assert not shown.take.chief_rays


def test_a_mark_without_a_size_stays(shot):
    stage, gathered, _ = shot
    for take, shown in zip(placed(stage, gathered), gathered.shown, strict=True):
        np.testing.assert_array_equal(
            take.observations.points_px[-1], shown.take.observations.points_px[-1]
        )


def test_marks_move_together_by_what_the_wavefront_may_get_wrong(shot):
    stage, gathered, dragged = shot
    move = 1e-3 * LENS.parameters()
    moved = replace(stage, parameters=stage.parameters + move)
    still, after = placed(stage, gathered), placed(moved, gathered)
    moves_mm = slight_moves_of_marks_mm(stage, gathered, move[None])
    for k, take in enumerate(moving_together(still, stage, gathered, moves_mm)):
        shared = take.shared_moves_mm
        assert shared is not None
        assert shared.shape[:2] == (1 + len(gathered.shown), 3)
        points = after[k].observations.points_px - still[k].observations.points_px
        largest = np.abs(dragged[k]).max()
        np.testing.assert_allclose(shared[0, 1], points * PIXEL_MM, atol=5e-5 * largest)
        np.testing.assert_allclose(
            shared[1 + k, 1, :-1], 0.05 * dragged[k], atol=0.002 * largest
        )
        assert not shared[:, :, -1].any()
    assert all(take.shared_moves_mm is None for take in still)


def test_every_mark_may_be_asked_how_it_moves(shot):
    """To rounding what a fit with other parameters would have said of each."""
    stage, gathered, _ = shot
    move = 1e-3 * LENS.parameters()
    moved = replace(stage, parameters=stage.parameters + move)
    before = placed(stage, gathered)
    moves_mm = moves_of_marks_mm(stage, gathered, move[None])
    asked = moving_together(before, stage, gathered, moves_mm)
    for take, still, after in zip(asked, before, placed(moved, gathered), strict=True):
        assert take.shared_moves_mm is not None
        points = after.observations.points_px - still.observations.points_px
        np.testing.assert_allclose(
            take.shared_moves_mm[0, 1], points * PIXEL_MM, atol=1e-9
        )


def test_drags_can_be_undone_by_a_move_of_the_parameters(shot):
    stage, gathered, dragged = shot
    deviation = np.zeros(LAYOUT.size)
    deviation[LAYOUT.blocks["coefficients"]] = 30.0
    stage = solved(freed(stage, deviation), 1)
    stage = replace(stage, parameters=LENS.parameters())
    undone = replace(stage, parameters=stage.parameters + undoing(stage, gathered))
    for before, after, drag in zip(
        placed(stage, gathered), placed(undone, gathered), dragged, strict=True
    ):
        there = after.observations.points_px - before.observations.points_px
        left = there[:-1] * PIXEL_MM - drag
        assert np.sum(left**2) < 0.01 * np.sum(drag**2)

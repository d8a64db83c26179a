"""Detected points move from their centroids to where their chief rays land."""

from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple, cast

import numpy as np
import pytest
from drawn_lens import F_NUMBERS, LAYOUT, PLACES_MM, Seidel, Shot, photographed
from found_marks import found_marks

from lensfit.detect.observations import Observations
from lensfit.fitting.chart_view import View
from lensfit.fitting.wavefront.adjusted_wavefront import (
    bias_cancelling_move,
    chief_ray_takes,
    takes_with_shared_moves,
)
from lensfit.fitting.wavefront.centroid_biases import (
    detected_point_moves_mm,
    linear_detected_point_moves_mm,
)
from lensfit.fitting.wavefront.dot_data import DotData
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.stages import Stage, first_stage, set_priors, solve_stage

LENS = Seidel(0.0, 0.0, 15.0, 5.0, defocus_mm=(0.1,), rims=((0.6, 1.1), (-0.5, 1.2)))
SENSOR_MM = (36.0, 40.0)
IMAGE_PX = (3600, 4000)
PIXEL_MM = 0.01
SHOTS = [Shot(0, 0, 1900.0), Shot(0, 1, 1900.0)]


def seen(points_mm: np.ndarray) -> Observations:
    """Centroids of all channels, and one more point whose size is unknown."""
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


def shot_lens() -> tuple[Stage, DotData, np.ndarray]:
    """The true fit, all dots, and their centroids from where the chief rays land."""
    dot_data = photographed(LENS, SHOTS, rays=2000)
    rng = np.random.default_rng(9)
    bias_mm_of_takes, photographs = [], []
    for k, shot in enumerate(SHOTS):
        radius = F_NUMBERS[0] / F_NUMBERS[shot.stop]
        mean = [
            LENS.landing_mm(
                LENS.opening(place / 20.0, radius, 100_000, rng), place, 0
            ).mean(0)
            for place in PLACES_MM
        ]
        bias_mm_of_takes.append(np.array(mean))
        take = View(
            f"take {k}", "grid", seen(PLACES_MM + mean), (40.0, 40.0), 8.0, 50.0,
            SENSOR_MM, F_NUMBERS[shot.stop], 1900.0, 2000.0,
        )  # fmt: skip
        marks = np.arange(len(PLACES_MM))
        photographs.append(
            SimpleNamespace(
                take=take,
                f_number=take.f_number,
                dot_images=SimpleNamespace(marks=marks, mosaic=None),
            )
        )
    dot_data = replace(dot_data, photographs=tuple(photographs))
    return (
        first_stage(dot_data, LAYOUT, LENS.parameters()),
        dot_data,
        np.array(bias_mm_of_takes),
    )


class Found(NamedTuple):
    """What of a fit says where chief rays land."""

    stage: Stage
    dot_data: DotData
    unfitted: None = None


@pytest.fixture(scope="module")
def shot():
    return shot_lens()


def test_comatic_dots_move_to_their_chief_rays(shot):
    stage, dot_data, bias_mm_of_takes = shot
    takes = chief_ray_takes(stage, dot_data)
    assert np.hypot(*bias_mm_of_takes[0].T).max() > 0.4 * PIXEL_MM
    for take, photograph in zip(takes, dot_data.photographs, strict=True):
        before, after = photograph.take.observations, take.observations
        middle = np.asarray(IMAGE_PX) / 2
        found = (after.points_px[:-1] - middle) * PIXEL_MM
        np.testing.assert_allclose(found, PLACES_MM, atol=3e-4)
        moved = after.channel_points_px - before.channel_points_px
        np.testing.assert_allclose(moved[:, :-1], np.stack([moved[1, :-1]] * 3))
        assert take.chief_rays
        assert not photograph.take.chief_rays


def test_a_point_without_a_size_stays(shot):
    stage, dot_data, _ = shot
    for take, photograph in zip(
        chief_ray_takes(stage, dot_data), dot_data.photographs, strict=True
    ):
        np.testing.assert_array_equal(
            take.observations.points_px[-1], photograph.take.observations.points_px[-1]
        )


def test_points_have_the_common_errors_of_the_wavefront(shot):
    stage, dot_data, bias_mm_of_takes = shot
    move = 1e-3 * LENS.parameters()
    moved = replace(stage, parameters=stage.parameters + move)
    still, after = chief_ray_takes(stage, dot_data), chief_ray_takes(moved, dot_data)
    moves_mm = linear_detected_point_moves_mm(stage, dot_data, move[None])
    found = cast(WavefrontFit, Found(stage, dot_data))
    takes = takes_with_shared_moves(still, found, lambda _: moves_mm)
    for k, take in enumerate(takes):
        shared = take.shared_moves_mm
        assert shared is not None
        assert shared.shape[:2] == (1 + len(dot_data.photographs), 3)
        points = after[k].observations.points_px - still[k].observations.points_px
        largest = np.abs(bias_mm_of_takes[k]).max()
        np.testing.assert_allclose(shared[0, 1], points * PIXEL_MM, atol=5e-5 * largest)
        np.testing.assert_allclose(
            shared[1 + k, 1, :-1], 0.05 * bias_mm_of_takes[k], atol=0.002 * largest
        )
        assert not shared[:, :, -1].any()
    assert all(take.shared_moves_mm is None for take in still)


def test_moves_of_any_size_are_those_of_a_fit_with_other_parameters(shot):
    """To rounding."""
    stage, dot_data, _ = shot
    move = 1e-3 * LENS.parameters()
    moved = replace(stage, parameters=stage.parameters + move)
    before = chief_ray_takes(stage, dot_data)
    moves_mm = detected_point_moves_mm(stage, dot_data, move[None])
    found = cast(WavefrontFit, Found(stage, dot_data))
    asked = takes_with_shared_moves(before, found, lambda _: moves_mm)
    for take, still, after in zip(
        asked, before, chief_ray_takes(moved, dot_data), strict=True
    ):
        assert take.shared_moves_mm is not None
        points = after.observations.points_px - still.observations.points_px
        np.testing.assert_allclose(
            take.shared_moves_mm[0, 1], points * PIXEL_MM, atol=1e-9
        )


def test_biases_can_be_cancelled_by_a_move_of_the_parameters(shot):
    stage, dot_data, bias_mm_of_takes = shot
    deviation = np.zeros(LAYOUT.size)
    deviation[LAYOUT.blocks["coefficients"]] = 30.0
    stage = solve_stage(set_priors(stage, deviation), 1)
    stage = replace(stage, parameters=LENS.parameters())
    undone = replace(
        stage, parameters=stage.parameters + bias_cancelling_move(stage, dot_data)
    )
    for before, after, bias_mm in zip(
        chief_ray_takes(stage, dot_data),
        chief_ray_takes(undone, dot_data),
        bias_mm_of_takes,
        strict=True,
    ):
        there = after.observations.points_px - before.observations.points_px
        left = there[:-1] * PIXEL_MM - bias_mm
        assert np.sum(left**2) < 0.01 * np.sum(bias_mm**2)

"""Robust weights: noise sized right, gross errors out, lines blind along themselves."""

from dataclasses import replace

import numpy as np
import pytest
from pinhole_shoot import MM_PER_PX, Camera, observations, shoot, take_of

from lensfit.detect.observations import LINE_OF_CONSTANT_I
from lensfit.fitting.adjust import Adjustment, adjust, with_robust_weights
from lensfit.fitting.geometric_start import start_of
from lensfit.fitting.parameters import fixed_prior, release, with_poses_free

NOISE_PX = 0.05
CAMERA = Camera(k=(-0.1, 0.0))


def _adjusted(takes) -> Adjustment:
    start = start_of(takes, takes)
    layout = start.layout
    prior = with_poses_free(fixed_prior(np.zeros(layout.size(len(takes)))), layout)
    prior = release(prior, layout.blocks["focal_length"], 0.3)
    prior = release(prior, layout.blocks["principal_point"], 0.05)
    prior = release(prior, layout.blocks["radial"], 0.3)
    return adjust(start.adjustment(layout, prior), rounds=3)


@pytest.fixture(scope="module")
def clean() -> Adjustment:
    return _adjusted(shoot(CAMERA, NOISE_PX))


def test_all_good_marks_are_used(clean):
    assert clean.used.sum() == 3 * 165
    assert clean.converged


def test_stated_noise_leaves_nothing_for_the_model(clean):
    """What is left besides detection noise is less than a third of that noise."""
    left_px = np.sqrt(clean.model_variance_mm2) / MM_PER_PX
    assert (left_px < NOISE_PX / 3).all()


def test_noise_nobody_stated_is_found_in_the_residuals():
    takes = shoot(CAMERA, 0.2)
    quiet = [
        replace(
            take,
            observations=replace(
                take.observations, covariance_px2=take.observations.covariance_px2 / 1e4
            ),
        )
        for take in takes
    ]
    left_px = np.sqrt(_adjusted(quiet).model_variance_mm2) / MM_PER_PX
    np.testing.assert_allclose(left_px.mean(), 0.2, rtol=0.1)


def test_gross_errors_lose_their_weight_and_change_nothing_else(clean):
    takes = shoot(CAMERA, NOISE_PX)
    rng = np.random.default_rng(5)
    wrong = []
    for k, take in enumerate(takes):
        points = take.observations.points_px.copy()
        bad = rng.choice(165, 5, replace=False)
        points[bad] += rng.uniform(3, 30, (5, 2)) * rng.choice([-1, 1], (5, 2))
        takes[k] = replace(
            take, observations=replace(take.observations, points_px=points)
        )
        wrong.append(bad)
    spoilt = _adjusted(takes)
    for k, bad in enumerate(wrong):
        assert not spoilt.used[k, bad].any()
    assert spoilt.used.sum() >= 3 * 160 - 3
    focal = spoilt.layout.blocks["focal_length"]
    change = np.exp(spoilt.parameters[focal] - clean.parameters[focal]) - 1
    assert abs(float(change[0])) < 2e-4


def test_padding_takes_no_part(clean):
    real = clean.stack.chunking.real
    assert not real.all()
    assert not np.asarray(clean.detections().whitening)[~real].any()


def test_line_samples_are_blind_along_their_line():
    """Upright lines, seen at places that slid along them by ten pixels."""
    camera = replace(CAMERA, rotations=((0.0, 0.0, 0.0),) * 3, k=(0.0, 0.0))
    points = shoot(camera)
    lines = []
    for k, take in enumerate(points):
        across = np.tile([1.0, 0.0], (165, 1))
        slide = np.random.default_rng(k).uniform(-10, 10, 165)[:, None] * [[0.0, 1.0]]
        image_mm = camera.marks_mm(k) + slide * MM_PER_PX
        seen = replace(
            observations(image_mm),
            family=np.full(165, LINE_OF_CONSTANT_I),
            normal=across,
        )
        lines.append(take_of(seen, take.name))
    adjustment = _line_start(lines)
    residual_px = adjustment.residual_mm()[:, :165] / MM_PER_PX
    assert not residual_px[..., 1].any()
    whitening = np.asarray(adjustment.detections().whitening)
    assert not whitening[..., 1].any()


def _line_start(takes) -> Adjustment:
    start = start_of(takes, takes)
    layout = start.layout
    return start.adjustment(layout, fixed_prior(np.zeros(layout.size(len(takes)))))


def test_noise_along_a_line_does_not_hide_what_the_model_leaves():
    """Samples know little of their place along the line, and that is no excuse."""
    rng = np.random.default_rng(5)
    lines = []
    for k, take in enumerate(shoot(CAMERA)):
        seen = take.observations
        across = rng.normal(0, 0.3, 165)
        lines.append(
            replace(
                take,
                observations=replace(
                    seen,
                    points_px=seen.points_px + across[:, None] * [1.0, 0.0],
                    covariance_px2=np.tile(np.diag([0.01**2, 1.5]), (165, 1, 1)),
                    family=np.full(165, LINE_OF_CONSTANT_I),
                    normal=np.tile([1.0, 0.0], (165, 1)),
                ),
                name=f"line {k}",
            )
        )
    adjustment = with_robust_weights(_pinhole_truth(lines))
    left_px = np.sqrt(adjustment.model_variance_mm2) / MM_PER_PX
    np.testing.assert_allclose(left_px, 0.3, rtol=0.25)


def _pinhole_truth(takes) -> Adjustment:
    """An adjustment that stands where points without noise put it."""
    fitted = _adjusted(shoot(CAMERA))
    start = start_of(takes, takes)
    layout = fitted.layout
    here = start.adjustment(layout, fixed_prior(np.zeros(layout.size(len(takes)))))
    return replace(
        here,
        parameters=fitted.parameters,
        frame=fitted.frame,
        stack=replace(here.stack, view=fitted.stack.view),
    )

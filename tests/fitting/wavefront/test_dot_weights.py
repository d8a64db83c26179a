"""Weights of cells: noise is estimated, clipped cells and outlying dots lose weight."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_lens import Seidel, Shot, photographed

from lensfit.fitting.wavefront.dot_weights import (
    initial_weights,
    relative_misfit,
    robust_weights,
)

READ, SHOT = 1e-3, 5e-4


@pytest.fixture(scope="module")
def noisy():
    """Dots with read and shot noise, and what a perfect model of them leaves."""
    clean = photographed(Seidel(), [Shot(0, 0), Shot(0, 1)], noise=0.0, rays=200_000)
    background = np.full(clean.light.shape[:2], 0.01)
    signal = np.clip(clean.light - background[..., None, None], 0, None)
    deviation = np.sqrt(READ**2 + SHOT * signal)
    residual = np.random.default_rng(1).normal(0, 1, signal.shape) * deviation
    light = signal + background[..., None, None] + residual
    read = np.full(clean.light.shape[:2], READ)
    return replace(clean, light=light, read_noise=read), residual, background, deviation


def test_weights_are_the_inverse_of_the_variance(noisy):
    dot_data, residual, background, deviation = noisy
    weight = robust_weights(dot_data, residual, background, 0.0)[:, 1]
    ratio = np.sqrt(weight) * deviation[:, 1]
    bright = deviation[:, 1] > 3 * READ
    assert bright.sum() > 100
    np.testing.assert_allclose(np.median(ratio[bright]), 1.0, atol=0.12)
    dark = deviation[:, 1] < 1.05 * READ
    np.testing.assert_allclose(np.median(ratio[dark]), 1.0, atol=0.12)


def test_a_dot_with_a_large_misfit_loses_weight(noisy):
    dot_data, residual, background, _ = noisy
    usual = robust_weights(dot_data, residual, background, 0.02)[:, 1]
    odd = residual.copy()
    odd[2] *= 12.0
    weight = robust_weights(dot_data, odd, background, 0.02)[:, 1]
    total, before = weight.sum((1, 2)), usual.sum((1, 2))
    assert total[2] < 0.2 * before[2]
    np.testing.assert_allclose(np.median(total / before), 1.0, atol=0.1)


def test_a_clipped_cell_counts_only_where_the_model_is_darker(noisy):
    dot_data, residual, background, _ = noisy
    clipped = np.zeros_like(dot_data.clipped)
    clipped[0, 1, 10:14, 10:14] = True
    marked = replace(dot_data, clipped=clipped)
    weight = robust_weights(marked, residual, background, 0.02)
    np.testing.assert_array_equal(
        weight[0, 1, 10:14, 10:14] > 0, residual[0, 1, 10:14, 10:14] > 0
    )
    assert not np.any(initial_weights(marked, 0.02)[clipped])


def test_masked_cells_never_count(noisy):
    dot_data, residual, background, _ = noisy
    for weight in (
        initial_weights(dot_data, 0.02),
        robust_weights(dot_data, residual, background, 0.02),
    ):
        assert not np.any(weight[~dot_data.valid])
        assert np.all(weight[dot_data.valid] > 0)


def test_the_misfit_is_relative_to_the_dot(noisy):
    dot_data, _, background, _ = noisy
    signal = dot_data.light - background[..., None, None]
    misfit = relative_misfit(dot_data, 0.1 * signal, background)
    np.testing.assert_allclose(misfit[:, 1], 0.1, rtol=1e-9)
    assert np.isnan(misfit[:, 0]).all()

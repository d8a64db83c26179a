"""Stated deviations against the scatter of many noisy photographs of one lens."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_lens import LAYOUT, PLACES_MM, Seidel, Shot, photographed

from lensfit.fitting.wavefront.stages import (
    first_stage,
    recentre_patches,
    set_priors,
    solve_stage,
)
from lensfit.fitting.wavefront.term_groups import (
    FINE,
    TermGroup,
    deviation_of,
    indices_of,
)
from lensfit.fitting.wavefront.uncertainty import (
    covariance_of,
    model_errors_of,
    parameter_moves,
    undetermined_term_groups,
)

LENS = Seidel(12.0, -9.0, 14.0, 8.0, defocus_mm=(0.2,))
DRAWS = 30
NOISE = 0.15
COEFFICIENTS, DEFOCUS = LAYOUT.blocks["coefficients"], LAYOUT.blocks["defocus"]
FREE = (
    TermGroup("defocus", (DEFOCUS.start,), (0.5,), FINE),
    TermGroup("third_order", tuple(range(1, 5)), (100.0,) * 4, FINE),
)


def started(dot_data, term_groups):
    stage = first_stage(dot_data, LAYOUT, LENS.parameters())
    return recentre_patches(set_priors(stage, deviation_of(term_groups, LAYOUT, FINE)))


@pytest.mark.slow
def test_deviations_are_the_scatter_of_the_fit():
    places = [PLACES_MM, PLACES_MM[:, ::-1] * [-0.9, 0.8], -PLACES_MM, PLACES_MM * 0.6]
    places = np.concatenate(places)
    still = photographed(LENS, [Shot(0, 0)], noise=0.0, places_mm=places)
    peak = still.light.max((2, 3), keepdims=True)
    still = replace(still, read_noise=NOISE * peak[..., 0, 0])
    found, told = [], []
    which = [i for term_group in FREE for i in term_group.indices]
    stage = solve_stage(started(still, FREE), 8)
    for seed in range(DRAWS):
        noise = np.random.default_rng(seed).normal(0, NOISE, still.light.shape) * peak
        noisy = replace(stage, dot_data=replace(still, light=still.light + noise))
        after = solve_stage(solve_stage(noisy, 8), 1)
        found.append(after.parameters[which])
        told.append(np.diag(covariance_of(after, FREE))[which])
    ratio = np.sqrt(np.mean(told, 0)) / np.std(found, 0, ddof=1)
    assert np.all((ratio > 0.6) & (ratio < 1.6)), ratio


def test_what_nobody_photographed_is_called_unseen():
    """A second group's defocus has no dots; its prior is all there is."""
    dot_data = photographed(LENS, [Shot(0, 0)], rays=20_000)
    nobody = TermGroup("other", (DEFOCUS.start + 1,), (0.5,), FINE)
    term_groups = (*FREE, nobody)
    stage = solve_stage(started(dot_data, term_groups), 6)
    covariance = covariance_of(stage, term_groups)
    assert undetermined_term_groups(stage, term_groups, covariance) == ("other",)
    assert np.sqrt(covariance[nobody.indices[0]][nobody.indices[0]]) == (
        pytest.approx(0.5, rel=1e-6)
    )
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    fixed = LAYOUT.blocks["rim_shift"]
    assert not np.any(covariance[fixed])
    moves = parameter_moves(stage, covariance)
    which = indices_of(term_groups)
    square = np.ix_(which, which)
    assert len(moves) <= len(which)
    deviation = np.sqrt(np.diag(covariance)[which])
    apart = (moves.T @ moves - covariance)[square] / np.outer(deviation, deviation)
    assert np.abs(apart).max() < 0.1


@pytest.mark.parametrize("lean", [1.0, 4.0, 1e4])
def test_what_is_stated_is_never_surer_than_the_lean_fit(lean):
    """Nor is what is added of any direction negative, however unsure that fit was."""
    dot_data = photographed(LENS, [Shot(0, 0)], rays=20_000)
    stage = solve_stage(started(dot_data, FREE), 6)
    own = lean * covariance_of(stage, FREE[:1])
    added = model_errors_of(stage, FREE, own).of_blur
    free = indices_of(FREE)
    unit = np.sqrt(np.diag(added + own)[free])
    assert np.all(unit > 0)
    inside = added[np.ix_(free, free)] / np.outer(unit, unit)
    np.testing.assert_allclose(inside, inside.T, atol=1e-12)
    assert np.linalg.eigvalsh(inside).min() > -1e-9
    # Astigmatism and the rest, which the lean fit held, are not known to be nothing.
    assert np.all(np.diag(added)[free[1:]] > 0)


def missed_and_noisy(missed: float, noise: float):
    """Stated deviations of a fit to images of which so much, in shares of the peak,
    is nothing that any lens would draw, and to noise that is known as such."""
    dot_data = photographed(LENS, [Shot(0, 0)], rays=50_000)
    peak = dot_data.light.max((2, 3), keepdims=True)
    rng = np.random.default_rng(5)
    pattern, grain = rng.normal(0, 1, (2, *dot_data.light.shape)) * peak
    light = dot_data.light + missed * pattern + noise * grain
    read_noise = dot_data.read_noise + noise * peak[..., 0, 0]
    photographs = replace(dot_data, light=light, read_noise=read_noise)
    stage = solve_stage(started(photographs, FREE), 6)
    added = model_errors_of(stage, FREE, covariance_of(stage, FREE)).of_blur
    return np.sqrt(np.diag(added)[indices_of(FREE)])


def test_what_the_model_visibly_misses_is_what_no_dot_shows():
    little, more = (missed_and_noisy(share, 0.0) for share in (0.006, 0.012))
    np.testing.assert_allclose(more / little, 2.0, rtol=0.2)


def test_noise_is_nothing_that_a_model_misses():
    missed, noisy = missed_and_noisy(0.02, 0.0), missed_and_noisy(0.0, 0.02)
    assert np.all(noisy < missed / 3)

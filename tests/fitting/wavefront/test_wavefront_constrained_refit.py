"""Dots' shape refitted at fixed centroid biases, and after the joint adjustment."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from drawn_lens import LAYOUT, Seidel, Shot, photographed

from lensfit.fitting.joint_adjustment import ErrorAmplitudes
from lensfit.fitting.wavefront.adjusted_wavefront import (
    adjust_wavefront,
    bias_cancelling_move,
    refit_with_fixed_biases,
    refit_without_centroid_bias,
    wavefront_errors,
)
from lensfit.fitting.wavefront.centroid_biases import centroid_biases_mm
from lensfit.fitting.wavefront.fit import WavefrontFit
from lensfit.fitting.wavefront.misfit import misfit_of
from lensfit.fitting.wavefront.stages import (
    chi_squared,
    first_stage,
    recentre_patches,
    set_priors,
)
from lensfit.fitting.wavefront.term_groups import FINE, TermGroup
from lensfit.fitting.wavefront.uncertainty import ModelErrors

PIXEL_MM = 0.01
LENS = Seidel(4.0, -3.0, 15.0, 5.0, defocus_mm=(0.1,), rims=((0.6, 1.1), (-0.5, 1.2)))
COEFFICIENTS = LAYOUT.blocks["coefficients"]
SYMMETRIC_UM = np.zeros(LAYOUT.size)
"""Of defocus and field curvature: no centroid bias behind a symmetric pupil."""
SYMMETRIC_UM[COEFFICIENTS][[0, 1]] = 12.0, -10.0


@pytest.fixture(scope="module")
def true_fit():
    """At the true parameters, coefficients free."""
    dot_data = photographed(LENS, [Shot(0, 0, 1900.0), Shot(0, 1, 1900.0)], rays=20_000)
    take = SimpleNamespace(pixel_mm=np.full(2, PIXEL_MM))
    photographs = tuple(SimpleNamespace(take=take) for _ in range(2))
    deviation = np.zeros(LAYOUT.size)
    deviation[COEFFICIENTS] = 30.0
    stage = first_stage(
        replace(dot_data, photographs=photographs), LAYOUT, LENS.parameters()
    )
    mean = np.where(deviation > 0, 0.0, LENS.parameters())
    stage = replace(set_priors(stage, deviation), mean=mean)
    return recentre_patches(stage, 4)


def moved(stage, by):
    return recentre_patches(replace(stage, parameters=stage.parameters + by), 1)


def rms_px(biases_mm):
    return np.sqrt(np.mean(np.sum(biases_mm**2, -1))) / PIXEL_MM


@pytest.mark.slow
def test_the_shape_is_refitted_at_fixed_biases(true_fit):
    """Symmetric blur was changed: it is restored as far as fixed biases allow."""
    spoiled = moved(true_fit, SYMMETRIC_UM)
    found = refit_with_fixed_biases(spoiled, true_fit.dot_data)
    least = chi_squared(true_fit)
    assert chi_squared(spoiled) > 3 * least
    assert chi_squared(found) - least < 0.2 * (chi_squared(spoiled) - least)
    held, after = (centroid_biases_mm(s, true_fit.dot_data) for s in (spoiled, found))
    assert rms_px(after - held) < 0.01


@pytest.mark.slow
def test_biases_that_are_fixed_at_wrong_values_stay_wrong(true_fit):
    """Their values come from elsewhere, however badly they fit the dots."""
    wrong = moved(true_fit, bias_cancelling_move(true_fit, true_fit.dot_data))
    found = refit_with_fixed_biases(wrong, true_fit.dot_data)
    held, after = (centroid_biases_mm(s, true_fit.dot_data) for s in (wrong, found))
    assert rms_px(after - held) < 0.005
    assert chi_squared(true_fit) < chi_squared(found) < chi_squared(wrong)


@pytest.fixture(scope="module")
def wavefront(true_fit):
    """Known to a few tenths of a micron."""
    indices = tuple(range(COEFFICIENTS.start, COEFFICIENTS.stop))
    term_groups = (
        TermGroup("third_order", indices, (30.0,) * len(indices), FINE, optional=False),
    )
    covariance = np.zeros((LAYOUT.size,) * 2)
    covariance[COEFFICIENTS, COEFFICIENTS] = np.diag(np.full(len(indices), 0.3**2))
    return WavefrontFit(
        dot_data=true_fit.dot_data,
        stage=true_fit,
        term_groups=term_groups,
        term_decisions=(),
        covariance=covariance,
        model_errors=ModelErrors(*np.zeros((2, *covariance.shape))),
        undetermined_term_groups=(),
        side_settled=True,
        other_side_cost=2.0,
        misfit=misfit_of(true_fit, term_groups),
    )


def test_the_adjusted_covariance_is_that_of_the_amounts(wavefront):
    """All amounts zero, every deviation halved; of biases a deviation of a tenth."""
    errors = wavefront_errors(wavefront)
    count = len(errors)
    variance = np.diag([0.1**2, *np.full(count - 1, 0.5**2)])
    told = adjust_wavefront(
        wavefront, errors, ErrorAmplitudes(np.zeros(count), variance)
    )
    assert told is not None
    of_errors = errors[1:].T @ errors[1:]
    expected = wavefront.covariance - 0.75 * of_errors
    expected = expected + 0.01 * np.outer(errors[0], errors[0])
    np.testing.assert_allclose(told.covariance, expected, atol=1e-9)
    parameter_move = told.stage.parameters - wavefront.stage.parameters
    assert np.abs(parameter_move[COEFFICIENTS]).max() < 1.0
    ratio = told.misfit.held_out_dots / wavefront.misfit.held_out_dots
    assert abs(ratio - told.misfit.median / wavefront.misfit.median) < 1e-9


def test_an_adjustment_does_not_spoil_the_shape_of_dots(wavefront):
    """Biases that exist are adjusted to zero."""
    errors = wavefront_errors(wavefront)
    value = np.zeros(len(errors))
    value[0] = 1.0
    said = ErrorAmplitudes(value, np.eye(len(errors)))
    assert adjust_wavefront(wavefront, errors, said) is None


def test_a_move_that_fails_leaves_the_wavefront(wavefront, monkeypatch):
    """A solve far off may end in NaN: then centroids stay where they were found."""
    nowhere = np.full((1, LAYOUT.size), np.nan)
    nothing = ErrorAmplitudes(np.ones(1), np.zeros((1, 1)))
    assert adjust_wavefront(wavefront, nowhere, nothing) is None
    where = "lensfit.fitting.wavefront.adjusted_wavefront.bias_cancelling_move"
    monkeypatch.setattr(where, lambda *_: nowhere[0])
    assert refit_without_centroid_bias(wavefront) is wavefront


def test_a_bias_that_is_cancelled_stays_in_doubt(wavefront, monkeypatch):
    """By all of it: the shape of the dots told another one."""
    move = 0.1 * wavefront_errors(wavefront)[1]
    where = "lensfit.fitting.wavefront.adjusted_wavefront.bias_cancelling_move"
    monkeypatch.setattr(where, lambda *_: move)
    told = refit_without_centroid_bias(wavefront)
    assert told is not wavefront
    doubted = wavefront.covariance + np.outer(move, move)
    np.testing.assert_allclose(told.covariance, doubted, rtol=1e-9, atol=1e-15)


def test_biases_too_large_for_a_step_are_not_cancelled(true_fit):
    """No parameter is free to cancel them."""
    fixed = replace(true_fit, deviation=1e-9 * true_fit.deviation)
    assert not bias_cancelling_move(fixed, true_fit.dot_data).any()

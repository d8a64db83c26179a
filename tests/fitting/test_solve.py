"""The solve: exact without noise, scattered as its covariance says with noise."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from pinhole_shoot import MM_PER_PX, Camera, shoot
from scipy.stats import chi2

from lensfit.fitting.adjust import (
    Adjustment,
    Problem,
    equations_at,
    problem_of,
    solve,
    total,
)
from lensfit.fitting.geometric_start import start_of
from lensfit.fitting.held_out import squared_px
from lensfit.fitting.levenberg import with_prior
from lensfit.fitting.parameters import fixed_prior, release, with_poses_free

NOISE_PX = 0.05
BROWN = Camera(k=(-0.12, 0.06))


def _ready(camera: Camera, radial_terms: int) -> Adjustment:
    """Homography start of a noise-free shoot, with a pinhole and radial terms free."""
    takes = shoot(camera)
    start = start_of(takes, takes)
    layout = start.layout
    prior = with_poses_free(fixed_prior(np.zeros(layout.size(len(takes)))), layout)
    prior = release(prior, layout.blocks["focal_length"], 0.3)
    prior = release(prior, layout.blocks["principal_point"], 0.05)
    first = layout.blocks["radial"].start
    prior = release(prior, slice(first, first + radial_terms), 1.0)
    adjustment = start.adjustment(layout, prior)
    noise = np.full(len(takes), (NOISE_PX * MM_PER_PX) ** 2)
    return replace(adjustment, model_variance_mm2=noise)


def _solved(adjustment: Adjustment, problem: Problem | None = None):
    return solve(
        jnp.asarray(adjustment.parameters),
        problem or problem_of(adjustment),
        adjustment.layout,
        tolerance=1e-12,
        most_steps=40,
        first_damping=1e-7,
    )


def test_pinhole_is_recovered_exactly():
    adjustment = _ready(Camera(), 0)
    found = _solved(adjustment)
    blocks = adjustment.layout.blocks
    assert bool(found.converged)
    parameters = np.asarray(found.parameters)
    focal_mm = 30.0 * np.exp(parameters[blocks["focal_length"]])
    centre_mm = 15.0 * parameters[blocks["principal_point"]]
    np.testing.assert_allclose(focal_mm, 30.6, rtol=1e-6)
    np.testing.assert_allclose(centre_mm, [0.12, -0.08], atol=1e-5)
    after = replace(adjustment, parameters=parameters)
    assert np.sqrt(squared_px(after).max()) < 1e-4


def test_browns_lens_is_matched_by_radial_terms():
    adjustment = _ready(BROWN, 5)
    found = _solved(adjustment)
    parameters = np.asarray(found.parameters)
    blocks = adjustment.layout.blocks
    focal_mm = 30.0 * np.exp(parameters[blocks["focal_length"]])
    np.testing.assert_allclose(focal_mm, 30.6, rtol=2e-4)
    after = replace(adjustment, parameters=parameters)
    assert np.sqrt(np.mean(squared_px(after))) < 2e-3
    a1 = parameters[blocks["radial"]][0]
    np.testing.assert_allclose(a1, 3 * -0.12 * (15.0 / 30.6) ** 2, rtol=0.02)


def test_fixed_parameters_stay_at_their_prior_mean():
    adjustment = _ready(BROWN, 2)
    found = np.asarray(_solved(adjustment).parameters)
    held = ~adjustment.prior.free
    np.testing.assert_array_equal(found[held], adjustment.prior.mean[held])


def test_running_out_of_steps_is_told():
    adjustment = _ready(BROWN, 3)
    found = solve(
        jnp.asarray(adjustment.parameters),
        problem_of(adjustment),
        adjustment.layout,
        tolerance=1e-12,
        most_steps=2,
        first_damping=1e-7,
    )
    assert not bool(found.converged)
    assert int(found.steps) == 2


def test_noise_scatters_the_solution_as_the_covariance_says():
    """(p - truth)^T A (p - truth) is chi-squared with as many squares as unknowns."""
    adjustment = _ready(BROWN, 3)
    truth = np.asarray(_solved(adjustment).parameters)
    adjustment = replace(adjustment, parameters=truth)
    # The Brown lens is not exactly ours: its projection becomes the truth.
    exact = adjustment.stack.observed_mm + adjustment.residual_mm()
    stack = replace(
        adjustment.stack, covariance_mm2=adjustment.stack.covariance_mm2 * 0.0
    )
    adjustment = replace(adjustment, stack=stack)
    problem = problem_of(adjustment)
    free = adjustment.prior.free
    here = jnp.asarray(truth)
    found = with_prior(total(equations_at(adjustment)), here, problem.prior)
    matrix = np.asarray(found.matrix)
    matrix = matrix[np.ix_(free, free)]
    rng = np.random.default_rng(0)
    squares, runs = 0.0, 12
    for _ in range(runs):
        noise = rng.normal(0, NOISE_PX * MM_PER_PX, exact.shape)
        seen = jnp.asarray(adjustment.stack.chunking.in_chunks(exact + noise))
        detections = problem.detections._replace(observed_mm=seen)
        found = _solved(adjustment, problem._replace(detections=detections))
        off = (np.asarray(found.parameters) - truth)[free]
        squares += off @ matrix @ off
    low, high = chi2.ppf([0.001, 0.999], runs * free.sum())
    assert low < squares < high

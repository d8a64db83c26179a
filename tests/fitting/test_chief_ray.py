"""The whole geometric fit on marks from an independent camera, with noise."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pinhole_shoot import FRONTAL, LATTICE, Camera, shoot, take_of

from lensfit.errors import FitError
from lensfit.fitting.adjust import equations_at, problem_of, total
from lensfit.fitting.chief_ray import ChiefRayFit, fit_chief_ray
from lensfit.fitting.geometry import distortion_of
from lensfit.fitting.levenberg import with_prior
from lensfit.optics.distortion import distorted_from_undistorted

NOISE_PX = 0.05
BROWN = Camera(k=(-0.12, 0.06))


@pytest.fixture(scope="module")
def brown() -> ChiefRayFit:
    return fit_chief_ray(shoot(BROWN, NOISE_PX, seed=1))


def _focal_length_mm(fit: ChiefRayFit) -> tuple[float, float]:
    """Value and standard error."""
    adjustment = fit.adjustment
    here = jnp.asarray(adjustment.parameters)
    found, problem = equations_at(adjustment), problem_of(adjustment)
    matrix, *_ = with_prior(total(found), here, problem.prior)
    where = adjustment.layout.blocks["focal_length"].start
    stated = float(adjustment.frame.stated_focal_length_mm)
    focal = stated * np.exp(adjustment.parameters[where])
    return focal, focal * float(
        np.sqrt(np.linalg.inv(np.asarray(matrix))[where, where])
    )


def _largest_error_px(fit: ChiefRayFit, camera: Camera) -> float:
    """Of the fitted map against the truth, over the marks that were photographed.

    Principal distance and point are the fit's own, so only the map is judged.
    """
    layout = fit.adjustment.layout
    shared = jnp.asarray(fit.adjustment.parameters[: layout.shared])
    lens = distortion_of(shared, layout, fit.adjustment.frame)
    x = np.stack(np.meshgrid(np.linspace(-8, 8, 9), np.linspace(-5, 5, 7)), -1)
    rays = np.concatenate([x.reshape(-1, 2) / 30.0, np.ones((63, 1))], -1)
    centre = np.asarray(lens.principal_point_mm)
    pinhole = rays[:, :2] * float(lens.principal_distance_mm) + centre
    mine = jax.jit(jax.vmap(lambda p: distorted_from_undistorted(p, lens)))(pinhole)
    return float(np.abs(np.asarray(mine) - camera.image_mm(rays)).max() / 0.01)


def test_focal_length_is_recovered_within_its_standard_error(brown):
    focal, error = _focal_length_mm(brown)
    assert brown.focal_length_free
    assert error < 0.02
    assert abs(focal - 30.6) < 3 * error


def test_held_out_error_is_the_noise(brown):
    """Two coordinates of noise each; half the marks predict the other half."""
    noise = NOISE_PX * np.sqrt(2)
    np.testing.assert_allclose(brown.held_out_rms_px, noise, rtol=0.1)
    np.testing.assert_allclose(brown.held_out_rms_px_of_take, noise, rtol=0.2)


def test_radial_terms_are_kept_and_nothing_that_is_not_there(brown):
    families = {name.rsplit("_", 1)[0] for name in brown.kept}
    assert families == {"radial"}
    left_out = {v.name for v in brown.decisions if not v.kept}
    assert {"squeeze", "decentering_2", "thin_prism_2", "anamorphic_3"} <= left_out
    assert any(name.startswith("free_field") for name in left_out)


def test_the_map_is_the_true_lens(brown):
    """A shift of the principal point is made up for by the poses, but not much."""
    assert _largest_error_px(brown, BROWN) < 6 * NOISE_PX


def test_a_pinhole_asks_for_no_terms_at_all():
    fit = fit_chief_ray(shoot(Camera(), NOISE_PX, seed=2))
    assert fit.kept == ()
    focal, error = _focal_length_mm(fit)
    assert abs(focal - 30.6) < 3 * error


def test_a_smooth_warp_that_is_not_radial_is_found_by_the_free_field():
    warped = replace(BROWN, warp_mm=0.02)
    fit = fit_chief_ray(shoot(warped, NOISE_PX, seed=3))
    assert any(name.startswith("free_field") for name in fit.kept)
    noise = NOISE_PX * np.sqrt(2)
    np.testing.assert_allclose(fit.held_out_rms_px, noise, rtol=0.2)


def test_decentering_is_found_by_its_name():
    fit = fit_chief_ray(shoot(replace(BROWN, p=(1.5e-3, -1e-3)), NOISE_PX, seed=4))
    assert any(name.startswith("decentering") for name in fit.kept)
    np.testing.assert_allclose(fit.held_out_rms_px, NOISE_PX * np.sqrt(2), rtol=0.1)


@pytest.mark.slow
def test_what_a_frontal_view_sees_of_decentering_is_not_taken_for_a_prism():
    camera = Camera(
        30.0, (0.0, 0.0), k=(-0.05, 0.0), p=(1.5e-3, -1e-3), rotations=FRONTAL[1:2]
    )
    fit = fit_chief_ray(shoot(camera, NOISE_PX, seed=5))
    assert any(name.startswith("decentering") for name in fit.kept)
    assert not any(name.startswith("thin_prism") for name in fit.kept)


def test_three_percent_of_gross_errors_change_nothing():
    takes = shoot(BROWN, NOISE_PX, seed=1)
    rng = np.random.default_rng(8)
    for k, take in enumerate(takes):
        points = take.observations.points_px.copy()
        bad = rng.choice(len(points), 5, replace=False)
        points[bad] += rng.uniform(2, 60, (5, 2)) * rng.choice([-1, 1], (5, 2))
        takes[k] = replace(
            take, observations=replace(take.observations, points_px=points)
        )
    fit = fit_chief_ray(takes)
    focal, error = _focal_length_mm(fit)
    assert abs(focal - 30.6) < 3 * error
    assert fit.adjustment.used.sum() >= 3 * 160 - 5
    np.testing.assert_allclose(fit.held_out_rms_px, NOISE_PX * np.sqrt(2), rtol=0.1)
    assert _largest_error_px(fit, BROWN) < 6 * NOISE_PX


def test_frontal_views_do_not_pretend_to_know_the_focal_length():
    fit = fit_chief_ray(shoot(replace(BROWN, rotations=FRONTAL), NOISE_PX, seed=5))
    assert not fit.focal_length_free
    focal_mm, error_mm = _focal_length_mm(fit)
    assert abs(focal_mm - 30.0) < 0.03 * 30.0
    assert error_mm > 0.1
    np.testing.assert_allclose(fit.held_out_rms_px, NOISE_PX * np.sqrt(2), rtol=0.1)


def test_one_row_of_marks_is_refused():
    whole = shoot(BROWN)[0]
    row = LATTICE[:, 1] == 0
    seen = whole.observations
    few = replace(
        seen,
        **{
            name: getattr(seen, name)[row]
            for name in (
                "lattice",
                "points_px",
                "covariance_px2",
                "family",
                "normal",
                "saturated",
                "overlapping",
                "flux",
                "diameter_px",
            )
        },
    )
    with pytest.raises(FitError, match=r"row\.tif: the points lie on one line"):
        fit_chief_ray([take_of(few, "row.tif")])


def test_a_wrong_pitch_contradicts_the_measured_distance():
    """At half the pitch boards are half as far away, or the lens is twice as long."""
    views = shoot(BROWN, pitch_mm=(20.0, 20.0))
    takes = [
        replace(view, target_distance_mm=950.0 + 40.0 * k)
        for k, view in enumerate(views)
    ]
    contradicted = [one for one in fit_chief_ray(takes).statements if one.contradicts]
    assert contradicted
    assert "check focal_length_mm, target_distance_mm, pitch_mm" in (
        contradicted[0].sentence
    )


def test_too_few_marks_are_refused_by_name():
    seen = shoot(BROWN)[0].observations
    few = replace(seen, points_px=seen.points_px[:5], lattice=seen.lattice[:5])
    with pytest.raises(FitError, match=r"corner\.tif: only 5 points, 12 are needed"):
        fit_chief_ray([take_of(few, "corner.tif")])

"""Fits that the photographs hardly determine, or not at all."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pinhole_takes import LATTICE, Shoot, take_of

from lensfit.detect.find import observe
from lensfit.errors import DetectionError, FitError
from lensfit.fitting.chief_ray import fit_chief_ray
from lensfit.fitting.levenberg import Prior, Quadratic, minimise
from lensfit.photograph import Photograph


def refused(measured, takes, match: str) -> None:
    with pytest.raises(FitError, match=match) as caught:
        fit_chief_ray(takes)
    measured("lines of the refusal", str(caught.value).count("\n") + 1, 1)


def test_one_row_of_dots(measured):
    """One row of dots (15 of them, three views): refused by name, in one line."""
    row = LATTICE[LATTICE[:, 1] == 0]
    refused(measured, Shoot(row).takes(), "view 0: the points lie on one line")


def test_collinear_dots(measured):
    """Collinear dots (a diagonal of the board, with and without noise): refused."""
    diagonal = np.repeat(np.arange(-9, 10.0)[:, None], 2, 1)
    for noise_px in (0.0, 0.05):
        takes = Shoot(diagonal, noise_px=noise_px).takes()
        refused(measured, takes, "view 0: the points lie on one line")


def test_all_dots_in_one_place(measured):
    """All dots in one place, or at no place (NaN): refused."""
    refused(measured, [take_of(np.full((165, 2), 900.0), LATTICE)], "on one line")
    there = Shoot(LATTICE).takes()[0].observations.points_px.copy()
    there[3] = np.nan
    refused(measured, [take_of(there, LATTICE)], "view: 1 points have a position")


def test_one_row_and_a_dot(measured):
    """One row and a dot beside it: a pose that nothing checks; refused."""
    row = np.append(LATTICE[LATTICE[:, 1] == 0], [[0.0, 5.0]], 0)
    refused(measured, Shoot(row).takes(), "view ")


@pytest.mark.slow
def test_two_rows_of_dots(measured):
    """Two rows of dots (three views): fitted to the noise of .05 px, times root 2."""
    rows = LATTICE[np.abs(LATTICE[:, 1] - 0.5) < 1]
    fit = fit_chief_ray(Shoot(rows).takes())
    measured("held out, px", fit.held_out_rms_px, 0.09)


def test_frontal_views(measured):
    """Frontal views of one distance (focal length and distance cannot be told apart):
    the stated focal length stays, to a tenth of its 3 %, and the marks are met."""
    fit = fit_chief_ray(Shoot(LATTICE, ((0.0, 0.0, 0.0),) * 3).takes())
    assert not fit.focal_length_free
    at = fit.adjustment.layout.blocks["focal_length"]
    measured("ln focal length", np.abs(fit.adjustment.parameters[at]).max(), 0.003)
    measured("held out, px", fit.held_out_rms_px, 0.09)


def test_a_shoot_without_noise(measured):
    """A shoot without noise (chi-squared falls to rounding): ends, at nothing left."""
    fit = fit_chief_ray(Shoot(LATTICE, noise_px=0.0).takes())
    measured("held out, px", fit.held_out_rms_px, 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("size", [4, 8, 12])
def test_normal_equations_without_digits(size: int, measured):
    """Near-singular normal equations (Hilbert matrices, condition 1e4 to 1e16): a
    finite step down to all but a millionth of what is to be had."""
    n = jnp.arange(size, dtype=float)
    matrix = 1.0 / (n[:, None] + n[None] + 1.0)
    truth = jnp.asarray(np.random.default_rng(0).normal(size=size))

    def equations(parameters):
        off = parameters - truth
        chi_squared = 1e-6 + off @ matrix @ off
        return Quadratic(matrix, matrix @ off, chi_squared), None

    prior = Prior(jnp.zeros(size), jnp.zeros(size), jnp.ones(size))

    @jax.jit
    def found():
        return minimise(equations, jnp.zeros(size), prior, 1e-6, 200, 1e-3)

    end = found()
    assert np.isfinite(end.parameters).all()
    start = float(equations(jnp.zeros(size))[0].chi_squared)
    left = float(equations(end.parameters)[0].chi_squared) - 1e-6
    measured("left of chi-squared", left / start, 1e-6)


def test_a_parameter_that_nothing_sees(measured):
    """A singular fit (a parameter that no mark sees, two that act as one): the rest is
    solved, the unseen one stays."""
    matrix = jnp.asarray([[2.0, 2.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    matrix = matrix.at[2, 2].set(1e-30)
    truth = jnp.asarray([1.0, 2.0, 0.0])

    def equations(parameters):
        off = parameters - truth
        return Quadratic(matrix, matrix @ off, 1e-9 + off @ matrix @ off), None

    prior = Prior(jnp.zeros(3), jnp.zeros(3), jnp.ones(3))
    end = jax.jit(lambda: minimise(equations, jnp.zeros(3), prior, 1e-9, 200, 1e-3))()
    measured("sum of the two", abs(float(end.parameters[:2].sum()) - 3), 1e-4)
    measured("the unseen", abs(float(end.parameters[2])), 1e-12)


def test_a_photograph_of_one_row(measured):
    """A photograph of one row of dots: the detector refuses it, in one line."""
    y, x = np.mgrid[:160, :480]
    away = np.hypot(x - 24 - np.round((x - 24) / 36) * 36, y - 80)
    pixels = np.clip(6.5 - away, 0.02, 0.9).astype(np.float32)[..., None]
    with pytest.raises(DetectionError) as caught:
        observe(Photograph(pixels, "row.exr", ""), "dot-grid")
    measured("lines of the refusal", str(caught.value).count("\n") + 1, 1)

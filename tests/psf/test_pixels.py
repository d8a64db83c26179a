"""Rays onto pixels: light, place, symmetry, convergence, derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from blurred_lens import CHROMATIC, ONE, blurred_lens, moments, perfect, spot_at
from jax.flatten_util import ravel_pytree

from lensfit.optics.terms import rotational_terms
from lensfit.psf.spot import diffraction_variance_mm2, image_of, profile_of

PITCH = jnp.array([0.012, 0.012])
FIELD_MM = jnp.array([6.0, 8.0])
F_NUMBER = jnp.asarray(1.4)


def splat(spot, cells, variance):
    """Light on a patch whose middle is the chief ray."""
    return image_of(spot, profile_of(spot, -cells / 2 * PITCH, PITCH, cells, variance))


@eqx.filter_jit
def kernel(
    field,
    blur,
    dz,
    rays=2048,
    size_px=48,
    f_number=F_NUMBER,
    stop=ONE,
    colour=CHROMATIC,
):
    lateral = jnp.zeros((*colour.shape, 2))
    spot = spot_at(field, blur, dz, rays, stop, colour, lateral)
    patch = splat(spot, size_px, diffraction_variance_mm2(f_number))
    return patch / jnp.sum(patch)


def centre_of(patch, pitch=0.012):
    """Centroid in mm from the middle of the array."""
    n = patch.shape[0]
    x = (np.arange(n) + 0.5 - n / 2) * pitch
    return np.array([(patch.sum(0) * x).sum(), (patch.sum(1) * x).sum()])


@pytest.mark.parametrize("dz", [-0.15, 0.0, 0.15])
def test_all_light_arrives_and_none_is_negative(dz: float):
    patch = np.asarray(kernel(FIELD_MM, blurred_lens(), jnp.asarray(dz)))
    np.testing.assert_allclose(patch.sum(), 1.0, rtol=1e-12)
    assert patch.min() >= 0


def test_pixels_have_the_moments_of_the_rays():
    """Place and size: x along columns, y down rows, the middle is the chief ray."""
    dz = jnp.asarray(0.1)
    patch = np.asarray(kernel(FIELD_MM, blurred_lens(), dz, size_px=96))

    spot = jax.jit(spot_at, static_argnums=3)(FIELD_MM, blurred_lens(), dz, 2048)
    centroid = moments(spot).centroid_mm
    # A pixel does not tell where in it a narrow ray fell: 0.3 px over root rays.
    np.testing.assert_allclose(centre_of(patch), centroid, atol=1e-4)
    assert np.abs(np.asarray(centroid)).min() > 2e-4


def test_mirror_images():
    dz, blur = jnp.asarray(0.1), blurred_lens()
    here = np.asarray(kernel(FIELD_MM, blur, dz))
    across = np.asarray(kernel(FIELD_MM * jnp.array([-1.0, 1.0]), blur, dz))
    assert np.linalg.norm(across[:, ::-1] - here) < 0.02 * np.linalg.norm(here)
    assert np.linalg.norm(across - here) > 0.2 * np.linalg.norm(here)


def test_an_axial_dot_is_round():
    patch = np.asarray(kernel(jnp.zeros(2), blurred_lens(), jnp.asarray(0.1)))
    for turned in (patch.T, patch[::-1], patch[:, ::-1]):
        assert np.linalg.norm(turned - patch) < 0.02 * np.linalg.norm(patch)


@pytest.mark.slow
@pytest.mark.parametrize("dz", [0.0, 0.15])
def test_converges_at_least_like_one_over_the_root_of_rays(dz: float):
    """The footprint blurs edges by the spacing of rays, which is rays^-1/2."""
    blur, at = blurred_lens(), jnp.asarray(dz)
    truth = np.asarray(kernel(FIELD_MM, blur, at, rays=40000))
    counts = np.array([128, 512, 2048, 8192])
    errors = [
        np.linalg.norm(np.asarray(kernel(FIELD_MM, blur, at, rays=int(n))) - truth)
        / np.linalg.norm(truth)
        for n in counts
    ]
    line = np.polyfit(np.log(counts), np.log(errors), 1)
    assert line[0] < -0.5, (line, errors)
    # A single count of rays is a fifth better or worse by chance.
    assert np.exp(np.polyval(line, np.log(2048))) < 0.02, errors


def test_a_uniform_disc_is_integrated_over_pixels():
    """Against the exact area of a circle in every pixel, by a fine grid."""
    # Slow enough that the exact disc is even: the stop closed to f/14.
    patch = kernel(
        jnp.zeros(2), perfect(blurred_lens()), jnp.asarray(2.0), 8000, 24,
        jnp.asarray(0.01), jnp.asarray(0.1), CHROMATIC[1:2],
    )  # fmt: skip
    radius = 2.0 * 0.1 * 0.5 / 1.4 / 0.012
    x = (np.arange(24 * 40) + 0.5) / 40 - 12
    disc = (np.hypot(x[:, None], x) < radius).reshape(24, 40, 24, 40).mean((1, 3))
    disc /= disc.sum()
    assert np.linalg.norm(np.asarray(patch) - disc) < 0.015 * np.linalg.norm(disc)


def test_diffraction_grows_with_the_f_number():
    wide, small = (diffraction_variance_mm2(jnp.asarray(n)) for n in (1.4, 14.0))
    np.testing.assert_allclose(small, 100 * wide)
    np.testing.assert_allclose(np.sqrt(wide), 0.42 * 540e-6 * 1.4)


FIFTH = rotational_terms(5)
"""Every order goes through the same lines, and compiling grows with their number."""


@jax.jit
def _summary(values, variance_mm2=1e-7):
    """Of a dot's patch, by all its parameters in one array."""
    _, restored = ravel_pytree(
        (blurred_lens(terms=FIFTH), jnp.zeros(2), jnp.asarray(0.0))
    )
    blur, field, shift = restored(values)
    weights = jnp.asarray(np.random.default_rng(0).normal(size=(16, 16)))
    patch = splat(spot_at(field, blur, shift, 96), 16, jnp.asarray(variance_mm2))
    return jnp.sum(weights * patch)


_summary_gradient = jax.jit(jax.grad(_summary))


@jax.jit
def _summary_along(values, way):
    """Derivative along a way, forwards."""
    return jax.jvp(_summary, (values,), (way,))[1]


@pytest.mark.slow
@pytest.mark.parametrize("place", [[0.0, 0.0], [6.0, 8.0]], ids=["axis", "field"])
@pytest.mark.parametrize("dz", [0.0, 0.08])
def test_derivatives_of_a_dot_agree_with_differences(place, dz):
    """Every parameter at once: coefficients, colours, rims, field point, defocus."""
    dot = blurred_lens(terms=FIFTH), jnp.asarray(place), jnp.asarray(dz)
    flat, _ = ravel_pytree(dot)
    reverse = _summary_gradient(flat, 1e-7)
    assert np.isfinite(reverse).all()
    scale = jnp.maximum(jnp.abs(flat), 0.1)
    way = scale * jnp.asarray(np.random.default_rng(1).normal(size=flat.shape))
    step = 1e-6
    ahead, behind = _summary(flat + step * way), _summary(flat - step * way)
    forward = _summary_along(flat, way)
    np.testing.assert_allclose(forward, reverse @ way, rtol=1e-9)
    np.testing.assert_allclose(forward, (ahead - behind) / (2 * step), rtol=1e-5)


def test_a_perfect_focus_has_finite_derivatives():
    """All rays at one point: no blur at all, where 1/|det| would be infinite."""
    sharp = blurred_lens(size_um=0.0, terms=FIFTH)
    flat, _ = ravel_pytree((sharp, jnp.zeros(2), jnp.asarray(0.0)))
    assert np.isfinite(_summary_gradient(flat, 0.0)).all()

"""The aberration function: exact defocus, Hamilton's gradient, smooth everywhere."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pupil_modes import landing_mm, path_mm

from lensfit.optics.aberration import (
    chief_sine,
    landing_and_jacobian_mm,
    local_wavefront,
    no_aberration,
)
from lensfit.optics.terms import rotational_terms

TERMS = rotational_terms(7)
COLOURS = rotational_terms(3)
FIELD_MM = jnp.array([8.0, -5.0])


_local = jax.jit(local_wavefront)
_landings = jax.jit(jax.vmap(landing_mm, (0, None, None)))


def lens(seed: int = 0, size_um: float = 8.0):
    rng = np.random.default_rng(seed)
    empty = no_aberration(
        TERMS, COLOURS, field_radius_mm=15.0, f_number=1.4, exit_pupil_distance_mm=80.0
    )
    return replace(
        empty,
        coefficients_um=jnp.asarray(rng.normal(0, size_um, len(TERMS))),
        colour_um=jnp.asarray(rng.normal(0, size_um / 4, (2, len(COLOURS)))),
        chief_bend=jnp.asarray(-0.1),
    )


def test_defocus_is_a_pencil_of_straight_rays():
    """Rays to a point, cut dz behind it: x = dz (tangent of ray - of chief ray)."""
    perfect = replace(lens(), coefficients_um=jnp.zeros(len(TERMS)))
    local = _local(FIELD_MM, jnp.asarray(0.0), perfect)
    u = jnp.array([0.7, 0.6])
    ray = chief_sine(FIELD_MM, perfect) + u * perfect.reference_sine
    chief = chief_sine(FIELD_MM, perfect)

    def tangent(p):
        return p / np.sqrt(1 - np.sum(np.square(p)))

    landed = landing_mm(u, jnp.asarray(-0.4), local)
    np.testing.assert_allclose(landed, -0.4 * (tangent(ray) - tangent(chief)))


def test_rays_land_at_the_gradient_of_the_path():
    aberrated = lens()
    local = _local(FIELD_MM, jnp.asarray(-0.7), aberrated)
    u, dz = jnp.array([0.4, -0.8]), jnp.asarray(0.3)
    slope = jax.jit(jax.grad(path_mm))(u, dz, local) / aberrated.reference_sine
    np.testing.assert_allclose(landing_mm(u, dz, local), slope, atol=1e-14)
    _, jacobian = landing_and_jacobian_mm(u, dz, local)
    np.testing.assert_allclose(jacobian, jacobian.T, atol=1e-14)


def test_the_chief_ray_lands_at_the_chief_ray():
    local = _local(FIELD_MM, jnp.asarray(0.5), lens())
    landed = landing_mm(jnp.zeros(2), jnp.asarray(0.7), local)
    np.testing.assert_allclose(landed, 0, atol=1e-15)


@pytest.mark.parametrize("index", range(len(TERMS)))
def test_a_coefficient_is_the_rms_spot_in_micrometres(index: int):
    """At the field's edge, over the full pupil, about the mean of the spot."""
    one = replace(
        lens(),
        coefficients_um=jnp.zeros(len(TERMS)).at[index].set(3.0),
        colour_um=jnp.zeros((2, len(COLOURS))),
    )
    local = _local(jnp.array([15.0, 0.0]), jnp.asarray(0.0), one)
    k = np.arange(4000)
    r, a = np.sqrt((k + 0.5) / 4000), k * np.pi * (3 - np.sqrt(5))
    u = jnp.asarray(np.stack([r * np.cos(a), r * np.sin(a)], -1))
    spot = np.asarray(_landings(u, jnp.asarray(0.0), local))
    rms_um = 1e3 * np.sqrt(spot.var(axis=0).sum())
    np.testing.assert_allclose(rms_um, 3.0, rtol=0.01)


@pytest.mark.parametrize("place", [[0.0, 0.0], [8.0, -5.0]], ids=["axis", "field"])
@pytest.mark.parametrize("dz", [0.0, 0.2])
def test_derivatives_agree_with_differences(place, dz):
    """On the axis and off, in focus and out, at the pupil's centre and rim."""
    start = lens()
    for u in (jnp.zeros(2), jnp.array([1.0, 0.0])):

        @jax.jit
        def landed(coefficients, field, shift, u=u):
            one = replace(start, coefficients_um=coefficients)
            local = local_wavefront(field, jnp.asarray(0.3), one)
            return landing_mm(u, shift, local)

        args = (start.coefficients_um, jnp.asarray(place), jnp.asarray(dz))
        rng = np.random.default_rng(1)
        way = tuple(jnp.asarray(rng.normal(size=a.shape)) for a in args)
        _, slope = jax.jvp(landed, args, way)
        step = 1e-5
        ahead = landed(*(a + step * w for a, w in zip(args, way, strict=True)))
        behind = landed(*(a - step * w for a, w in zip(args, way, strict=True)))
        np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), atol=1e-9)
        assert np.isfinite(slope).all()

"""The two sections of an anamorphic lens: closed forms of first order, and symmetry."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pupil_modes import landing_mm, path_mm, shift_path_mm

from lensfit.optics.aberration import (
    landing_and_jacobian_mm,
    local_wavefront,
    no_aberration,
)
from lensfit.optics.depth import cylinder_mm, object_shift, sections_of
from lensfit.optics.paraxial import FirstOrder, defocus_mm

C_MM, OFFSET_MM, CHART_MM = 43.0, 60.0, 2400.0
SLOPES = [(0.0, 0.0), (0.3, 0.0), (0.0, 0.16), (-0.25, 0.12)]


def lens_mm(squeeze: float) -> np.ndarray:
    """Principal distances along x and y."""
    return C_MM * np.array([squeeze**-0.5, squeeze**0.5])


def chart(slope, squeeze: float, distance_mm: float, reference_mm=CHART_MM):
    """An object of an undistorted lens, from the reference distance."""
    focal = 1 / (1 / C_MM + 1 / (reference_mm - OFFSET_MM))
    basics = FirstOrder(*(jnp.asarray(n) for n in (focal, 1.0, OFFSET_MM)))
    shift = object_shift(
        jnp.asarray(slope), jnp.diag(jnp.asarray(lens_mm(squeeze))), basics,
        jnp.asarray(reference_mm), jnp.asarray(distance_mm),
    )  # fmt: skip
    return shift, basics


def focused(slope, squeeze: float, focus_mm: float, p) -> np.ndarray:
    """Where rays of a chart land: sharp at `focus_mm` in both sections."""
    shift, basics = chart(slope, squeeze, CHART_MM)
    dz = squeeze * defocus_mm(basics, jnp.asarray(focus_mm), jnp.asarray(CHART_MM))
    sections = sections_of(shift, jnp.asarray(C_MM), jnp.log(squeeze))
    t = np.asarray(slope)
    chief = jnp.asarray(t / np.sqrt(1 + t @ t))
    slopes = chief_defocus(jnp.asarray(p), chief)
    return np.asarray(dz * slopes + p @ cylinder_mm(dz, jnp.zeros(()), sections))


def chief_defocus(p, chief):
    """Tangents of the rays' angles less the chief ray's."""

    def tangent(q):
        return q / jnp.sqrt(1 - jnp.sum(q * q, -1, keepdims=True))

    return tangent(p + chief[None]) - tangent(chief[None])


@pytest.mark.parametrize("squeeze", [1.33, 1.92])
@pytest.mark.parametrize("focus_mm", [1700.0, 4000.0])
def test_out_of_focus_both_sections_are_those_of_first_order(squeeze, focus_mm):
    """Radius c^2 V sin in each: an oval of 1 : s^2, 1 : s once desqueezed."""
    p = 1e-4 * np.eye(2)
    landed = np.diag(focused((0.0, 0.0), squeeze, focus_mm, p)) / 1e-4
    # c grows with the sensor's distance, so that c^2 is the product of both.
    focal = 1 / (1 / C_MM + 1 / (CHART_MM - OFFSET_MM))
    at_focus = focal / (1 - focal / (focus_mm - OFFSET_MM))
    vergence = 1 / (focus_mm - OFFSET_MM) - 1 / (CHART_MM - OFFSET_MM)
    wanted = lens_mm(squeeze) ** 2 * at_focus / C_MM * vergence
    np.testing.assert_allclose(landed, wanted, rtol=1e-6)
    np.testing.assert_allclose(landed[1] / (landed[0] * squeeze), squeeze, rtol=1e-6)


_path_slopes = jax.jit(jax.vmap(jax.grad(shift_path_mm), (0, None)))
_path_curvature = jax.jit(jax.hessian(shift_path_mm))
_path_slope = jax.jit(jax.grad(path_mm))
_landing, _landing_and_jacobian = map(jax.jit, (landing_mm, landing_and_jacobian_mm))


@pytest.mark.parametrize(
    ("slope", "squeeze"), [(t, 1.0) for t in SLOPES] + [(SLOPES[0], 1.8)]
)
def test_focusing_away_is_moving_the_object(slope, squeeze):
    """To first order in the change and in the pupil."""
    focus_mm = CHART_MM + 1.0
    p = 1e-3 * np.array([[1.0, 0.0], [0.0, 1.0], [0.7, -0.7]])
    by_focus = focused(slope, squeeze, focus_mm, p)
    moved, _ = chart(slope, squeeze, CHART_MM, reference_mm=focus_mm)
    by_depth = _path_slopes(jnp.asarray(p), moved)
    np.testing.assert_allclose(by_focus, by_depth, atol=2e-3 * np.abs(by_depth).max())


@pytest.mark.parametrize("slope", SLOPES)
def test_a_cylinder_is_seen_under_the_angle_of_its_section(slope):
    """Along x it does all over the field what a sphere of the same power does."""
    shift, _ = chart(slope, 1.0, 1900.0)
    sections = sections_of(shift, jnp.asarray(C_MM), jnp.zeros(()))
    hessian = _path_curvature(jnp.zeros(2), shift)
    per_mm = (shift.reference_per_mm - shift.vergence_per_mm) * C_MM**2
    t = np.asarray(slope)
    found = cylinder_mm(jnp.zeros(()), per_mm, sections)
    if t[0] == 0 or t[1] == 0:
        np.testing.assert_allclose(found[0, 0], hessian[0, 0], rtol=1e-9)
    assert np.linalg.matrix_rank(found) == 1


def test_a_spherical_lens_has_but_one_section():
    shift, _ = chart((0.2, -0.1), 1.0, CHART_MM)
    sections = sections_of(shift, jnp.asarray(C_MM), jnp.zeros(()))
    nothing = cylinder_mm(jnp.asarray(0.7), jnp.zeros(()), sections)
    np.testing.assert_array_equal(nothing, np.zeros((2, 2)))


def local_of(slope, beyond_mm: float, dz: float):
    shift, _ = chart(slope, 1.9, 1900.0)
    sections = sections_of(shift, jnp.asarray(C_MM), jnp.log(1.9))
    aberration = no_aberration(
        (), field_radius_mm=13.0, f_number=2.0, exit_pupil_distance_mm=60.0
    )
    field = jnp.asarray(slope) * jnp.asarray(lens_mm(1.9))
    matrix = cylinder_mm(jnp.asarray(dz), jnp.asarray(beyond_mm), sections)
    return local_wavefront(field, jnp.zeros(()), aberration, shift, matrix)


@pytest.mark.parametrize("slope", SLOPES)
def test_rays_land_where_the_path_says(slope):
    """x = dE/dp, and its own derivative by differences."""
    local, dz = local_of(slope, 0.05, 0.4), jnp.asarray(0.4)
    u = jnp.array([0.6, -0.5])
    by_path = _path_slope(u, dz, local) / local.reference_sine
    landed, slopes = _landing_and_jacobian(u, dz, local)
    np.testing.assert_allclose(landed, by_path, rtol=1e-10)
    for k in range(2):
        step = 1e-5 * jnp.eye(2)[k]
        ends = [_landing(u + s, dz, local) for s in (step, -step)]
        np.testing.assert_allclose(slopes[:, k], (ends[0] - ends[1]) / 2e-5, rtol=1e-5)


@pytest.mark.parametrize("mirror", [(-1.0, 1.0), (1.0, -1.0)])
def test_both_mirrors_hold(mirror):
    m, u, dz = jnp.asarray(mirror), jnp.array([0.6, -0.5]), jnp.asarray(-0.3)
    slope = jnp.array([0.25, 0.12])
    landed = landing_mm(u, dz, local_of(slope, 0.05, -0.3))
    mirrored = landing_mm(m * u, dz, local_of(m * slope, 0.05, -0.3))
    np.testing.assert_allclose(mirrored, m * landed, rtol=1e-12)

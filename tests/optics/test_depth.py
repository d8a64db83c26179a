"""Another object distance: the law against exact rays of traced lenses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pupil_modes import shift_path_mm

from data_synth.aim import (
    chief_aim_mm,
    chief_landings_mm,
    pupil_bounds_mm,
    rays_through_pupil,
    tracer_from_object,
)
from data_synth.lens import REFERENCE_NM, set_lens
from data_synth.paraxial import first_order
from data_synth.prescription import load_prescription
from lensfit.optics.depth import object_shift
from lensfit.optics.paraxial import FirstOrder, image_shift_mm


def known(lens) -> FirstOrder:
    data = first_order(lens.surfaces, REFERENCE_NM)
    pupil = data.exit_pupil_magnification / data.entrance_pupil_magnification
    return FirstOrder(
        jnp.asarray(data.focal_length_mm),
        jnp.asarray(pupil),
        jnp.asarray(-data.entrance_pupil_z_mm),
    )


def pencil(lens, slope: float, distance_mm: float):
    """(p, x) of the rays of one point against its chief ray, sensor orientation."""
    away = distance_mm + lens.pupil_z_mm
    point = tracer_from_object(np.array([[slope * away, 0.0, distance_mm]]))
    middle = chief_aim_mm(lens, point, 540.0)
    chief, _ = rays_through_pupil(lens, point, middle, 540.0)
    low, high = pupil_bounds_mm(lens, point, 540.0)
    axis = (np.arange(24) + 0.5) / 24
    grid = low + (high - low) * np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    rays, _ = rays_through_pupil(lens, np.repeat(point, len(grid), 0), grid, 540.0)
    p = chief.direction[:, :2] - rays.direction[:, :2]
    return p[rays.passed], (chief.landing_mm - rays.landing_mm)[rays.passed]


def fitted(p, x, degree: int = 9):
    """Gradient of a polynomial of even y degree, as a function of p."""
    scale = np.abs(p).max()

    def columns(at):
        u, v = (at / scale).T
        rows = []
        for i in range(degree + 1):
            for j in range(0, degree + 1 - i, 2):
                if i + j > 1:
                    by_u = i * u ** max(i - 1, 0) * v**j
                    by_v = j * u**i * v ** max(j - 1, 0)
                    rows.append(np.stack([by_u, by_v], -1))
        return np.stack(rows, -1)

    design = columns(p).reshape(2 * len(p), -1)
    solved, *_ = np.linalg.lstsq(design, x.reshape(-1), rcond=None)
    return lambda at: columns(at) @ solved


@pytest.mark.parametrize("name", ["nikkor_28", "kreitzer_135", "petzval_50"])
@pytest.mark.parametrize("factor", [0.5, 2.0, 1e5])
def test_rays_of_another_depth_follow(name: str, factor: float):
    """Within 5 % of the blur they add, and closer than paraxial defocus."""
    prescription = load_prescription(name)
    reference = 40 * prescription.states[0].focal_length_mm
    lens = set_lens(prescription, focus_distance_mm=reference)
    basics = known(lens)
    half_angle = 0.35 * np.hypot(*prescription.sensor_size_mm) / lens.focal_length_mm
    slope, distance = float(half_angle), factor * reference
    model = fitted(*pencil(lens, slope, reference))
    p, x = pencil(lens, slope, distance)

    away = reference + lens.pupil_z_mm
    steps = np.array([[slope, 0], [slope + 1e-3, 0], [slope, 1e-3]])
    points = np.column_stack([steps * away, np.full(3, reference)])
    at = chief_landings_mm(lens, tracer_from_object(points), 540.0)
    jacobian = jnp.asarray(np.stack([at[1] - at[0], at[2] - at[0]], -1) / 1e-3)
    shift = object_shift(
        jnp.array([slope, 0.0]), jacobian, basics,
        jnp.asarray(reference), jnp.asarray(distance),
    )  # fmt: skip
    added = jax.jit(jax.vmap(jax.grad(shift_path_mm), (0, None)))
    change = x - model(p)
    ours = np.linalg.norm(change - added(jnp.asarray(p), shift))
    thin = image_shift_mm(basics, jnp.asarray(reference))
    thin = float(thin - image_shift_mm(basics, jnp.asarray(distance)))
    theirs = np.linalg.norm(change - thin * p)
    assert ours < 0.05 * np.linalg.norm(change)
    assert ours < 0.8 * theirs, (ours, theirs)


def test_infinity_is_an_ordinary_distance():
    basics = FirstOrder(jnp.asarray(50.0), jnp.asarray(1.3), jnp.asarray(55.0))
    slope, jacobian = jnp.array([0.2, 0.1]), 51.0 * jnp.eye(2)

    def path(distance, p):
        shift = object_shift(slope, jacobian, basics, jnp.asarray(2000.0), distance)
        return shift_path_mm(p, shift)

    p = jnp.array([0.2, -0.1])
    np.testing.assert_allclose(
        path(jnp.asarray(jnp.inf), p), path(jnp.asarray(1e12), p), rtol=1e-8
    )
    slopes = jax.jit(jax.grad(path, (0, 1)))(jnp.asarray(jnp.inf), p)
    assert all(np.isfinite(value).all() for value in slopes)
    np.testing.assert_allclose(path(jnp.asarray(2000.0), p), 0, atol=1e-15)

"""Light through the pupil, against rays traced exactly."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from pupil_modes import landing_mm
from scipy.optimize import least_squares

from data_synth.aim import chief_aim_mm, rays_through_pupil
from data_synth.lens import SetLens, set_lens
from data_synth.prescription import load_prescription
from lensfit.optics.aberration import (
    Aberration,
    chief_sine,
    light_density,
    local_wavefront,
    no_aberration,
)
from lensfit.optics.terms import Term, rotational_terms

CHART_MM, NM = 2000.0, 540.0
TERMS = tuple(t for t in rotational_terms(9) if t != Term(2, 0, 0, 0))
STEP_MM = 1e-3


class Pencil(NamedTuple):
    """Rays of one object point, the chief ray first: direction cosines in the scene and
    at the sensor, and where they land, in sensor orientation."""

    scene: np.ndarray
    sensor: np.ndarray
    landing_mm: np.ndarray


def pencil_of(lens: SetLens, across_mm: float, pupil_mm: np.ndarray) -> Pencil:
    point = np.array([[across_mm, 0.0, -CHART_MM]])
    aim = chief_aim_mm(lens, point, NM) + np.insert(pupil_mm, 0, 0.0, axis=0)
    traced, direction = rays_through_pupil(lens, point.repeat(len(aim), 0), aim, NM)
    return Pencil(direction[:, :2], -traced.direction[:, :2], -traced.landing_mm)


def discs(radius_mm: float) -> np.ndarray:
    """Points of the entrance pupil on five rings."""
    reach = radius_mm * np.sqrt(np.linspace(0.08, 1.0, 5))
    azimuth = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    return (reach[:, None, None] * ring).reshape(-1, 2)


def with_chief_rays(bare: Aberration, pencils: list[Pencil]) -> Aberration:
    """The aberration function with its exit pupil where chief rays come from."""
    chief_mm, sine = (
        np.array([part[0] for part in parts])
        for parts in zip(*((p.landing_mm, p.sensor) for p in pencils), strict=True)
    )
    chief_mm = jnp.asarray(chief_mm)

    def of(numbers) -> Aberration:
        distance, bend = jnp.exp(numbers[0]), numbers[1]
        return replace(bare, exit_pupil_distance_mm=distance, chief_bend=bend)

    @jax.jit
    def sines(numbers):
        return jax.vmap(chief_sine, (0, None))(chief_mm, of(numbers))

    def off(numbers) -> np.ndarray:
        return (np.asarray(sines(jnp.asarray(numbers))) - sine).ravel()

    return of(jnp.asarray(least_squares(off, [4.0, 0.0]).x))


def measured(
    bare: Aberration, pencils: list[Pencil]
) -> tuple[Aberration, float, float]:
    """Coefficients and defocus, linear in where rays land; what is left, mm."""

    def landed(numbers, chief_mm, u):
        one = replace(bare, coefficients_um=numbers[1:])
        local = local_wavefront(chief_mm, jnp.zeros(()), one)
        return jax.vmap(landing_mm, (0, None, None))(u, numbers[0], local).ravel()

    slopes = jax.jit(jax.jacfwd(landed))
    none = jnp.zeros(1 + len(TERMS))
    parts = [(jnp.asarray(p.landing_mm[0]), u_of(p, bare)) for p in pencils]
    design = np.concatenate([np.asarray(slopes(none, *part)) for part in parts])
    seen = np.concatenate(
        [(p.landing_mm[1:] - p.landing_mm[0]).ravel() for p in pencils]
    )
    found = np.linalg.lstsq(design, seen, rcond=None)[0]
    left = float(np.sqrt(np.mean((seen - design @ found) ** 2)))
    full = replace(bare, coefficients_um=jnp.asarray(found[1:]))
    return full, float(found[0]), left


def u_of(pencil: Pencil, aberration: Aberration) -> jnp.ndarray:
    sines = pencil.sensor[1:] - pencil.sensor[0]
    return jnp.asarray(sines / float(aberration.reference_sine))


def traced_density(lens: SetLens, across_mm: float, pupil_mm: np.ndarray) -> np.ndarray:
    """Cosines in the scene over cosines at the sensor, as areas."""
    here = pencil_of(lens, across_mm, pupil_mm)
    moved = [pencil_of(lens, across_mm, pupil_mm + s) for s in STEP_MM * np.eye(2)]
    scene, sensor = (
        np.linalg.det(
            np.stack([(getattr(m, n) - getattr(here, n))[1:] for m in moved], -1)
        )
        for n in ("scene", "sensor")
    )
    return np.abs(scene / sensor)


def test_light_of_a_fast_double_gauss():
    """The light that rays carry varies by percents over the pupil, and follows from
    where rays land, which alone the aberration function was told."""
    lens = set_lens(
        load_prescription("angenieux_50"),
        focal_length_mm=50.0,
        f_number=1.4,
        focus_distance_mm=CHART_MM,
    )
    pupil_mm = discs(0.9 * lens.pupil_radius_mm)
    fields = np.linspace(0.0, 460.0, 9)
    pencils = [pencil_of(lens, across, pupil_mm) for across in fields]
    bare = no_aberration(
        TERMS, field_radius_mm=13.0, f_number=1.4, exit_pupil_distance_mm=50.0
    )
    bare = with_chief_rays(bare, pencils)
    aberration, defocus_mm, left_mm = measured(bare, pencils)
    assert left_mm < 2e-3, "rays are not described"
    every = jax.jit(jax.vmap(light_density, (0, None, None)))
    local_at = jax.jit(local_wavefront)
    for across, pencil in zip(fields[2::2], pencils[2::2], strict=True):
        traced = traced_density(lens, across, pupil_mm)
        chief_mm = jnp.asarray(pencil.landing_mm[0])
        local = local_at(chief_mm, jnp.zeros(()), aberration)
        told = every(u_of(pencil, aberration), jnp.asarray(defocus_mm), local)
        traced, told = traced / traced.mean(), np.asarray(told / told.mean())
        assert np.ptp(traced) > 0.01
        np.testing.assert_allclose(told, traced, atol=0.02 * np.ptp(traced))

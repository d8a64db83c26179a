"""Marks of broad dots behind coma, as detection finds those counted ray by ray."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import (
    Seidel,
    assert_slopes_are_differences,
    broad_target,
    cell_counts,
)
from scipy.special import erf

from lensfit.detect.centroids import SMOOTHING_DARK_PX, measure, windows_of
from lensfit.detect.dot_images import CELLS
from lensfit.fitting.wavefront.detected_point import (
    detected_dot_centre,
    detected_point_offset_slopes_mm,
    detected_point_offsets_mm,
)
from lensfit.fitting.wavefront.dot_arrays import DetectionAperture, undrawn

PIXEL_MM, RADIUS_PX, SPACING_PX = 0.01, 3.4, 12.0
FIELD_MM = np.array([13.0, -9.0])
COMATIC = Seidel(coma_um=8.0, spherical_um=4.0, defocus_mm=(0.03, 0.0, 0.0))
STEPS = np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j])
MIDDLE = np.array([36.3, 35.8])
"""Of the picture of seven by seven dots, whose chief ray lands there."""


def aperture_of(bright: bool) -> DetectionAperture:
    moment_px2 = np.eye(2)[None] * 1.1 * RADIUS_PX**2 / 4
    windows = windows_of(moment_px2, np.full(1, SPACING_PX), bright=bright)
    smoothing = np.zeros(1) if bright else np.full(1, SMOOTHING_DARK_PX)
    to_edge = np.linalg.cholesky(windows.shape_px2)
    return DetectionAperture(to_edge, windows.ring, windows.core, smoothing)


def seen_of(bright: bool, field_mm=FIELD_MM) -> tuple[Any, ...]:
    """A dot among others, as the fit has it."""
    disc_mm = np.eye(2)[None] * RADIUS_PX * PIXEL_MM
    neighbour_offsets_mm = STEPS[None] * SPACING_PX * PIXEL_MM
    broad = undrawn(1)._replace(
        disc_mm=disc_mm,
        neighbour_offsets_mm=neighbour_offsets_mm,
        size_width=np.full(1, 0.01),
        aperture=aperture_of(bright),
    )
    return broad_target(broad, field_mm, PIXEL_MM)


def photographed(bright: bool, rays: int = 1_500_000) -> np.ndarray:
    """Seven by seven of the dot, in numpy alone."""
    rng = np.random.default_rng(4)
    h = FIELD_MM / 20.0
    u = COMATIC.opening(h, 1.0, rays, rng)
    reach, turn = np.sqrt(rng.random(rays)), 2 * np.pi * rng.random(rays)
    disc = RADIUS_PX * reach[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)
    at = COMATIC.landing_mm(u, FIELD_MM, 0) / PIXEL_MM + disc + MIDDLE
    at = at + rng.normal(0, 0.1, at.shape)
    size = round(7 * SPACING_PX)
    one = cell_counts(at, np.zeros(2), 1.0, size)
    step = round(SPACING_PX)
    shifts = step * np.arange(-3, 4)
    all_dots = np.sum([np.roll(one, (j, i), (0, 1)) for i in shifts for j in shifts], 0)
    light = all_dots / rays * np.pi * RADIUS_PX**2
    return (0.02 + light if bright else 1 - 0.9 * light).astype(np.float32)


_offsets_mm, _offset_slopes_mm = (
    jax.jit(partial(function, kind="disc"), static_argnames="layout")
    for function in (detected_point_offsets_mm, detected_point_offset_slopes_mm)
)


def offsets_mm(parameters, bright):
    return _offsets_mm(parameters, *seen_of(bright))


@pytest.mark.parametrize("bright", [True, False])
def test_detection_finds_the_mark_there(bright):
    moment_px2 = np.eye(2)[None] * 1.1 * RADIUS_PX**2 / 4
    windows = windows_of(moment_px2, np.full(1, SPACING_PX), bright=bright)
    polarity = "bright" if bright else "dark"
    picture = photographed(bright)
    found = measure(picture, MIDDLE[None], windows, polarity).centre_px[0] - MIDDLE
    parameters = jnp.asarray(COMATIC.parameters())
    expected = np.asarray(offsets_mm(parameters, bright))[1] / PIXEL_MM
    np.testing.assert_allclose(found, expected, atol=0.04 * np.hypot(*expected))
    assert np.hypot(*found) > 0.2


def test_a_rim_moves_less_than_all_the_light():
    parameters = jnp.asarray(COMATIC.parameters())
    bright, dark = (np.asarray(offsets_mm(parameters, b))[1] for b in (True, False))
    assert np.hypot(*dark) < 0.97 * np.hypot(*bright)


@pytest.mark.slow
@pytest.mark.parametrize("bright", [True, False])
def test_slopes_agree_with_differences(bright):
    seen = seen_of(bright)
    parameters = jnp.asarray(COMATIC.parameters())
    found = _offset_slopes_mm(parameters, *seen)[1]
    assert_slopes_are_differences(
        found, lambda values: _offsets_mm(values, *seen)[1], parameters
    )


def test_an_even_disc_is_where_its_chief_ray_lands():
    still = Seidel(spherical_um=6.0, defocus_mm=(0.03, 0.0, 0.0))
    for bright in (True, False):
        seen = seen_of(bright, np.zeros(2))
        found = _offsets_mm(jnp.asarray(still.parameters()), *seen)
        np.testing.assert_allclose(found, 0, atol=2e-2 * PIXEL_MM)


@pytest.mark.slow
def test_slanted_light_moves_no_mark():
    """What lies under a dot is taken off as a plane."""
    along = np.arange(CELLS) - (CELLS - 1) / 2
    x, y = np.meshgrid(along, along)
    disc = 0.5 - 0.5 * erf(np.hypot(x, y) - RADIUS_PX)
    for bright in (True, False):
        aperture = jax.tree.map(lambda a: jnp.asarray(a[0]), aperture_of(bright))
        for slope in (0.0, 0.01):
            found = detected_dot_centre(jnp.asarray(disc + slope * x), aperture)
            np.testing.assert_allclose(found, 0, atol=1e-3)

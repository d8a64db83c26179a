"""Middles of lines behind coma, as detection finds those counted ray by ray."""

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

from lensfit.detect.line_profile import Centres, Stretches, Window, measure_centres
from lensfit.fitting.wavefront.detected_point import (
    detected_point_offset_slopes_mm,
    detected_point_offsets_mm,
    line_light_shares,
)
from lensfit.fitting.wavefront.dot_arrays import undrawn

PIXEL_MM, WIDTH_PX, PITCH_PX, TURN_RAD = 0.01, 3.0, 30.0, 0.12
FIELD_MM = np.array([13.0, -9.0])
COMATIC = Seidel(coma_um=8.0, spherical_um=4.0, defocus_mm=(0.03, 0.0, 0.0))
WINDOW = Window(half_width_px=3.0, fade_px=1.0, flank_px=3.0, rows=10)
SIDE, MIDDLE, RAYS = 64, 32.0, 2_000_000
SIDES = np.array(
    [
        [np.cos(TURN_RAD), np.sin(TURN_RAD)],
        [-np.sin(TURN_RAD), np.cos(TURN_RAD)],
    ]
)
"""Of the grid, in columns: across lines of constant i, and along them."""
_OF_A_LINE = [
    partial(function, kind="line")
    for function in (detected_point_offsets_mm, detected_point_offset_slopes_mm)
]
_offsets_mm, _offset_slopes_mm, _light_shares = (
    jax.jit(function, static_argnames="layout")
    for function in (*_OF_A_LINE, line_light_shares)
)


def seen_of(field_mm=FIELD_MM) -> tuple[Any, ...]:
    """A line sample, as the fit has it."""
    window_px = np.array([WINDOW.half_width_px, WINDOW.fade_px, WINDOW.flank_px])
    broad = undrawn(1)._replace(
        disc_mm=np.eye(2)[None] * WIDTH_PX * PIXEL_MM / np.sqrt(3),
        square_mm=SIDES[None] * PITCH_PX * PIXEL_MM,
        lattice=np.array([[4.0, 2.5]]),
        line_width=np.full((1, 2), WIDTH_PX / PITCH_PX),
        line_window_mm=np.tile(np.cos(TURN_RAD) * PIXEL_MM * window_px, (1, 3, 1)),
        size_width=np.full(1, 0.01),
    )
    return broad_target(broad, field_mm, PIXEL_MM)


def photographed(along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """One line through the middle, counted in numpy alone."""
    rng = np.random.default_rng(4)
    u = COMATIC.opening(FIELD_MM / 20.0, 1.0, RAYS, rng)
    started = MIDDLE + along * rng.uniform(-SIDE, SIDE, (RAYS, 1))
    started = started + across * rng.uniform(-WIDTH_PX / 2, WIDTH_PX / 2, (RAYS, 1))
    landed = COMATIC.landing_mm(u, FIELD_MM, 0) / PIXEL_MM + started
    landed = landed + rng.normal(0, 0.1, landed.shape)
    return cell_counts(landed, np.zeros(2), 1.0, SIDE)


def as_detected(picture: np.ndarray, slope: float) -> Centres:
    """Through the middle of the picture, along its rows."""
    middle = np.array([MIDDLE])
    here = Stretches(middle, middle, np.array([slope]), np.zeros(1))
    return measure_centres(picture, here, WINDOW, 1)


@pytest.mark.slow
@pytest.mark.parametrize("family", [0, 1])
def test_detection_finds_the_middle_there(family):
    along, across = SIDES[:, 1 - family], SIDES[:, family]
    picture = photographed(along, across)
    if family:  # level lines are read along columns
        picture, along = picture.T, along[::-1]
    seen = as_detected(picture, along[0] / along[1])
    found = seen.dx_px[0] * np.cos(TURN_RAD)
    parameters = jnp.asarray(COMATIC.parameters())
    offset_mm = np.asarray(_offsets_mm(parameters, *seen_of())[1])
    expected = offset_mm @ across / PIXEL_MM
    assert found == pytest.approx(expected, rel=0.04)
    assert abs(found) > 0.2
    of_a_row = RAYS / (2 * SIDE) / np.cos(TURN_RAD)
    share = _light_shares(parameters, *seen_of())[1, family]
    assert seen.flux_per_row[0] / of_a_row == pytest.approx(float(share), abs=0.005)
    assert share < 0.998


@pytest.mark.slow
def test_slopes_agree_with_differences():
    seen, parameters = seen_of(), jnp.asarray(COMATIC.parameters())
    found = _offset_slopes_mm(parameters, *seen)[1]
    assert_slopes_are_differences(
        found, lambda values: _offsets_mm(values, *seen)[1], parameters
    )


def test_an_even_blur_moves_no_line():
    still = Seidel(spherical_um=6.0, defocus_mm=(0.03, 0.0, 0.0))
    found = _offsets_mm(jnp.asarray(still.parameters()), *seen_of(np.zeros(2)))
    np.testing.assert_allclose(found, 0, atol=2e-2 * PIXEL_MM)


def test_single_precision_stays_single():
    def single(part):
        part = jnp.asarray(part)
        floating = jnp.issubdtype(part.dtype, jnp.floating)
        return part.astype(jnp.float32) if floating else part

    *arrays, layout, scale = seen_of()
    arrays = jax.tree.map(single, (jnp.asarray(COMATIC.parameters()), *arrays))
    scale = jax.tree.map(single, scale)
    # The dtypes alone: nothing needs to be compiled for them.
    for function in _OF_A_LINE:
        made = jax.eval_shape(partial(function, layout=layout, scale=scale), *arrays)
        assert made.dtype == jnp.float32

"""Where a lens is sharp, from the widths of its dots: a lens drawn by random rays."""

from dataclasses import replace

import numpy as np
import pytest
from drawn_lens import LAYOUT, SINE, Seidel, Shot, photographed

from lensfit.fitting.wavefront.coarse import dot_widths_mm, likely_focus, set_focus

PER_UM = np.sqrt(2) * 1e-3 / SINE
"""Defocus that shifts rays as much as a coefficient of 1 um does."""
LENS = Seidel(-30.0, -60.0, defocus_mm=(0.05, 0.55, -0.35))
SHOTS = [Shot(group, stop) for group in range(3) for stop in range(2)]


@pytest.fixture(scope="module")
def dot_data():
    return photographed(LENS, SHOTS, rays=20_000)


def found(dot_data, most=1, lens=LENS):
    """With the defocus of each take known but for what is common."""
    stated_mm = np.array(lens.defocus_mm) - lens.defocus_mm[0]
    return likely_focus(dot_data, dot_widths_mm(dot_data), stated_mm, most)


@pytest.mark.parametrize("side", [1, -1])
def test_curvature_and_astigmatism_of_either_side_are_told(side):
    curvature, astigmatism = side * LENS.curvature_um, side * LENS.astigmatism_um
    lens = replace(LENS, curvature_um=curvature, astigmatism_um=astigmatism)
    [best] = found(photographed(lens, SHOTS, rays=20_000), lens=lens)
    along, across = (PER_UM * (2 * curvature + s * astigmatism) for s in (1, -1))
    axis_mm = np.array(lens.defocus_mm) - PER_UM * curvature
    assert best.along_mm == pytest.approx(along, abs=0.1)
    assert best.across_mm == pytest.approx(across, abs=0.1)
    np.testing.assert_allclose(best.axis_mm, axis_mm, atol=0.06)


def test_a_lens_focused_so_is_that_lens(dot_data):
    [best] = found(dot_data)
    parameters = set_focus(np.zeros(LAYOUT.size), LAYOUT, best, SINE)
    truth = LENS.parameters()
    blocks = LAYOUT.blocks
    np.testing.assert_allclose(
        parameters[blocks["coefficients"]], truth[blocks["coefficients"]], atol=9.0
    )
    np.testing.assert_allclose(
        parameters[blocks["defocus"]], truth[blocks["defocus"]], atol=0.06
    )


def test_choices_are_apart_and_the_best_comes_first(dot_data):
    choices = found(dot_data, 4)
    places = np.array([[c.axis_mm[0], c.along_mm, c.across_mm] for c in choices])
    for k in range(4):
        others = np.delete(places, k, 0)
        assert np.abs(others - places[k]).max(-1).min() > 0.2
    np.testing.assert_array_equal(choices[0].axis_mm, found(dot_data)[0].axis_mm)


def test_takes_of_which_nothing_is_known_are_left_out(dot_data):
    widths_mm = dot_widths_mm(dot_data)
    assert likely_focus(dot_data, widths_mm, np.full(3, np.nan), 2) == []
    stated_mm = np.array([0.0, 0.5, np.nan])
    [best] = likely_focus(dot_data, widths_mm, stated_mm, 1)
    assert np.isnan(best.axis_mm[2])
    assert np.isfinite(best.along_mm)

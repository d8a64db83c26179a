"""Statements beside dots: what they cost, and what dots alone do not tell."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import LAYOUT, REFERENCE_MM, Seidel, Shot, photographed

from lensfit.fitting.wavefront.stages import first_stage, focus_stated, freed, solved
from lensfit.fitting.wavefront.start import defocus_deviation_mm, stated_defocus_mm
from lensfit.fitting.wavefront.stated import (
    Stated,
    stated_equations,
    stated_opening,
    stated_opening_and_focus,
)
from lensfit.fitting.wavefront.term_groups import FINE, deviation_of, families_of

NEAR_MM, FAR_MM = 1600.0, 2600.0
DEFOCUS = LAYOUT.blocks["defocus"]
RADII = LAYOUT.blocks["rim_radius"]


@pytest.fixture(scope="module")
def gathered():
    """Near and far, as stated distances have them, wide open and stopped down."""
    shots = [Shot(0, 0, NEAR_MM), Shot(1, 0, FAR_MM), Shot(0, 1, NEAR_MM)]
    blank = photographed(Seidel(defocus_mm=(0.3, -0.2)), shots, rays=500)
    near_mm, far_mm = stated_defocus_mm(blank)
    lens = Seidel(spherical_um=4.0, defocus_mm=(float(near_mm), float(far_mm)))
    return photographed(lens, shots, rays=30_000)


def lens_of(defocus_mm: np.ndarray, rim: float = 3.0) -> np.ndarray:
    found = np.zeros(LAYOUT.size)
    found[DEFOCUS][: len(defocus_mm)] = defocus_mm
    found[RADII] = np.tile([rim, 0.0], LAYOUT.rims)
    return found


def cost(gathered, defocus_mm, stated: Stated | None = None) -> float:
    if stated is None:
        there = stated_defocus_mm(gathered)
        stated = stated_opening_and_focus(gathered, LAYOUT, there)
    parameters = jnp.asarray(lens_of(defocus_mm))
    return float(stated_equations(parameters, stated, LAYOUT).chi_squared)


def test_distances_that_hold_cost_nothing(gathered):
    assert cost(gathered, stated_defocus_mm(gathered)) < 1e-12


def test_defocus_in_proportion_is_as_sure_as_focal_length_and_f_number(gathered):
    """hypot(2 x 3 %, 5 %); what all are moved by together costs little."""
    stated_mm = stated_defocus_mm(gathered)
    deviation = np.hypot(2 * 0.03, 0.05)
    assert 0.8 < cost(gathered, stated_mm * (1 + deviation)) < 1.0
    assert cost(gathered, stated_mm + 0.3 * np.abs(stated_mm).max()) < 0.5


def test_each_distance_errs_by_its_own_width(gathered):
    """The middle one off by three of them, beside others as stated."""
    near, far = gathered.groups
    focused = near._replace(focus_distance_mm=REFERENCE_MM)
    three = replace(gathered, groups=(near, focused, far))
    off = np.array([0.0, 3.0, 0.0]) * defocus_deviation_mm(three)
    assert 3.0 < cost(three, stated_defocus_mm(three) + off) < 9.0


def test_the_width_of_a_distance_is_that_of_a_tape_measure(gathered):
    """Newton: defocus goes with f^2 / X, and X by .3 % and 5 mm."""
    first = gathered.first_order
    f = float(first.focal_length_mm)
    to_front_mm = NEAR_MM - float(first.entrance_pupil_offset_mm) - f
    width_mm = np.hypot(5.0, 0.003 * NEAR_MM)
    expected = f**2 / (to_front_mm - width_mm) - f**2 / to_front_mm
    assert defocus_deviation_mm(gathered)[0] == pytest.approx(expected, rel=1e-6)


def test_distances_that_dots_contradict_lose_weight(gathered):
    """Near and far swapped: the statement counts for a thirtieth."""
    stated_mm = stated_defocus_mm(gathered)
    swapped = stated_opening_and_focus(gathered, LAYOUT, stated_mm[::-1].copy())
    honest = stated_opening_and_focus(gathered, LAYOUT, stated_mm)
    away = 1.1 * stated_mm
    assert cost(gathered, away, swapped) < 0.035 * cost(gathered, away, honest)


def test_where_no_distance_is_stated_there_is_no_evidence(gathered):
    silent = replace(
        gathered,
        groups=tuple(g._replace(focus_distance_mm=None) for g in gathered.groups),
    )
    anywhere = np.array([1.0, 3.0])
    found = stated_opening_and_focus(silent, LAYOUT, anywhere)
    assert cost(silent, anywhere, found) == 0.0


def test_rims_that_pass_the_axial_beam_cost_nothing():
    stated = stated_opening(LAYOUT)
    wide = stated_equations(jnp.asarray(lens_of(np.zeros(3), 1.0)), stated, LAYOUT)
    cut = stated_equations(jnp.asarray(lens_of(np.zeros(3), 0.9)), stated, LAYOUT)
    assert float(wide.chi_squared) == 0.0
    assert float(cut.chi_squared) > 50.0
    assert np.all(np.asarray(cut.gradient)[RADII][::2] < 0.0)


def test_a_narrow_opening_far_from_focus_differs_from_a_wide_one_near_to_it(gathered):
    """Both draw the same discs: statements alone say which it is."""
    blind = first_stage(gathered, LAYOUT, lens_of(stated_defocus_mm(gathered) / 0.85))
    narrow = blind.parameters.copy()
    narrow[RADII] = np.tile([0.85, 0.0], LAYOUT.rims)
    families = families_of(gathered, LAYOUT, narrow[DEFOCUS][:2])
    start = replace(blind, parameters=narrow, mean=narrow.copy())
    start = freed(start, deviation_of(families, LAYOUT, FINE))
    nothing = start.stated._replace(rows=0.0 * start.stated.rows)
    found = solved(focus_stated(replace(start, stated=nothing)), 30, 1e-6)
    scale = found.parameters[DEFOCUS][:2] / stated_defocus_mm(gathered)
    np.testing.assert_allclose(scale, 1.0, atol=0.04)
    assert found.parameters[RADII][::2].min() > 0.97

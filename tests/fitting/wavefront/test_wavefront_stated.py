"""Statements beside dots: what they cost, and what dots alone do not tell."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import LAYOUT, REFERENCE_MM, Seidel, Shot, photographed

from lensfit.fitting.fall_off.illumination import FallOffFit
from lensfit.fitting.wavefront.dot_data import Beam, PhotographedFallOff
from lensfit.fitting.wavefront.parameters import aberration_of
from lensfit.fitting.wavefront.stages import (
    add_stated_distances,
    first_stage,
    set_priors,
    solve_stage,
    stage_with_beam,
)
from lensfit.fitting.wavefront.start_values import (
    defocus_deviation_mm,
    stated_defocus_mm,
)
from lensfit.fitting.wavefront.stated import (
    Statements,
    stated_beam,
    stated_equations,
    statements_with_distances,
    statements_without_distances,
)
from lensfit.fitting.wavefront.term_groups import (
    FINE,
    candidate_term_groups,
    deviation_of,
)
from lensfit.optics.aberration import landing_and_jacobian_mm, local_wavefront

NEAR_MM, FAR_MM = 1600.0, 2600.0
DEFOCUS = LAYOUT.blocks["defocus"]
RADII = LAYOUT.blocks["rim_radius"]


@pytest.fixture(scope="module")
def dot_data():
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


def cost(dot_data, defocus_mm, stated: Statements | None = None) -> float:
    if stated is None:
        there = stated_defocus_mm(dot_data)
        stated = statements_with_distances(dot_data, LAYOUT, lens_of(there))
    parameters = jnp.asarray(lens_of(defocus_mm))
    return float(stated_equations(parameters, stated, LAYOUT).chi_squared)


def test_distances_that_hold_cost_nothing(dot_data):
    assert cost(dot_data, stated_defocus_mm(dot_data)) < 1e-12


def test_defocus_in_proportion_is_as_sure_as_focal_length_and_f_number(dot_data):
    """hypot(2 x 3 %, 5 %); what all are moved by together costs little."""
    stated_mm = stated_defocus_mm(dot_data)
    deviation = np.hypot(2 * 0.03, 0.05)
    assert 0.8 < cost(dot_data, stated_mm * (1 + deviation)) < 1.0
    assert cost(dot_data, stated_mm + 0.3 * np.abs(stated_mm).max()) < 0.5


def test_each_distance_errs_by_its_own_width(dot_data):
    """The middle one off by three of them, beside others as stated."""
    near, far = dot_data.groups
    focused = near._replace(focus_distance_mm=REFERENCE_MM)
    three = replace(dot_data, groups=(near, focused, far))
    off = np.array([0.0, 3.0, 0.0]) * defocus_deviation_mm(three)
    assert 3.0 < cost(three, stated_defocus_mm(three) + off) < 9.0


def test_the_width_of_a_distance_is_that_of_a_tape_measure(dot_data):
    """Newton: defocus goes with f^2 / X, and X by .3 % and 5 mm."""
    first = dot_data.first_order
    f = float(first.focal_length_mm)
    to_front_mm = NEAR_MM - float(first.entrance_pupil_offset_mm) - f
    width_mm = np.hypot(5.0, 0.003 * NEAR_MM)
    expected = f**2 / (to_front_mm - width_mm) - f**2 / to_front_mm
    assert defocus_deviation_mm(dot_data)[0] == pytest.approx(expected, rel=1e-6)


def test_distances_that_dots_contradict_lose_weight(dot_data):
    """Near and far swapped: the statement counts for a thirtieth."""
    stated_mm = stated_defocus_mm(dot_data)
    swapped = statements_with_distances(dot_data, LAYOUT, lens_of(stated_mm[::-1]))
    honest = statements_with_distances(dot_data, LAYOUT, lens_of(stated_mm))
    away = 1.1 * stated_mm
    assert cost(dot_data, away, swapped) < 0.035 * cost(dot_data, away, honest)


def test_where_no_distance_is_stated_there_is_no_evidence(dot_data):
    silent = replace(
        dot_data,
        groups=tuple(g._replace(focus_distance_mm=None) for g in dot_data.groups),
    )
    anywhere = np.array([1.0, 3.0])
    found = statements_with_distances(silent, LAYOUT, lens_of(anywhere))
    assert cost(silent, anywhere, found) == 0.0


def test_rims_that_pass_the_axial_beam_cost_nothing(dot_data):
    stated = statements_without_distances(dot_data, LAYOUT)
    wide = stated_equations(jnp.asarray(lens_of(np.zeros(3), 1.0)), stated, LAYOUT)
    cut = stated_equations(jnp.asarray(lens_of(np.zeros(3), 0.9)), stated, LAYOUT)
    assert float(wide.chi_squared) == 0.0
    assert float(cut.chi_squared) > 50.0
    assert np.all(np.asarray(cut.gradient)[RADII][::2] < 0.0)


def test_rims_that_shut_a_corner_contradict_its_photograph(dot_data):
    """Two rims that part company: what they leave of the widest and of the narrowest
    stop falls with their shift, and costs from the last twentieth on."""
    stated = statements_without_distances(dot_data, LAYOUT)

    def found(shift: float):
        lens = lens_of(np.zeros(3), 1.2)
        shifts = np.resize([shift, 0.0, -shift, 0.0], 2 * LAYOUT.rims)
        lens[LAYOUT.blocks["rim_shift"]] = shifts
        return stated_equations(jnp.asarray(lens), stated, LAYOUT)

    open_still, nearly_shut, shut = map(found, (1.0, 1.07, 1.2))
    assert float(open_still.chi_squared) == 0.0
    assert 0.0 < float(nearly_shut.chi_squared) < float(shut.chi_squared)
    assert np.asarray(shut.gradient)[LAYOUT.blocks["rim_shift"]][0] > 0.0


STRETCH = LAYOUT.blocks["stretch"]
CORNER_MM, TERMS = 14.0, 4


def lens_of_stretch(along: float) -> np.ndarray:
    """Its opening grows towards the corner by so much along the field direction."""
    found = lens_of(np.zeros(3))
    found[STRETCH] = [along, 0.0, 0.0, 0.0]
    return found


def photographed_loss(dot_data, loss: np.ndarray, f_number: float):
    """A loss that goes as the squared field height: of every f-number the same."""
    control = np.linspace(0, 1, TERMS + 1)[1:] * loss
    covariance = np.tile(1e-8 * np.eye(TERMS), (3, 1, 1))
    fit = FallOffFit(f_number, np.tile(control, (3, 1)), CORNER_MM, covariance)
    principal_mm = float(dot_data.scale.principal_distance_mm)
    return PhotographedFallOff(f_number, principal_mm, fit)


def with_losses(dot_data, *losses: float):
    """Of the widest f-number and of the next, photographed while focusing."""
    known = zip(losses, dot_data.f_numbers, strict=False)
    shown = tuple(photographed_loss(dot_data, loss, f) for loss, f in known)
    dots = dot_data.dots._replace(focus=np.where(dot_data.dots.group == 0, 1.0, -1.0))
    return replace(dot_data, fall_offs=shown, dots=dots)


def lit_cost(dot_data, along: float, stated: Statements | None = None) -> float:
    stated = stated or statements_without_distances(dot_data, LAYOUT)
    parameters = jnp.asarray(lens_of_stretch(along))
    return float(stated_equations(parameters, stated, LAYOUT).chi_squared)


def corner_height(dot_data) -> float:
    return CORNER_MM / float(dot_data.scale.field_radius_mm)


def test_the_opening_is_as_large_as_the_fall_off_says(dot_data):
    """-ln of its area over that on the axis is the loss."""
    along = 0.2
    loss = -along * corner_height(dot_data) ** 2
    seen = with_losses(dot_data, loss, loss)
    assert lit_cost(seen, along) < 1e-3
    assert lit_cost(seen, along + 0.1) > 2.0


def test_a_charts_light_is_the_same_at_every_f_number(dot_data):
    """Uneven by its width it costs one unit; what only one f-number shows costs more
    by far."""
    uneven = 0.05 * corner_height(dot_data) ** 2
    assert 0.3 < lit_cost(with_losses(dot_data, uneven, uneven), 0.0) < 1.2
    assert lit_cost(with_losses(dot_data, 2 * uneven, 0.0), 0.0) > 10.0


def test_without_a_photographed_fall_off_there_is_no_evidence(dot_data):
    assert lit_cost(dot_data, 0.4) == 0.0


def test_at_one_focus_distance_fall_off_is_no_evidence(dot_data):
    """Nothing curves while focusing there."""
    seen = with_losses(dot_data, 0.5, 0.5)
    still = seen.dots._replace(focus=np.zeros(len(seen.take)))
    assert lit_cost(seen, 0.0) > 1.0
    assert lit_cost(replace(seen, dots=still), 0.0) == 0.0


def test_a_fall_off_that_dots_contradict_loses_weight(dot_data):
    seen = with_losses(dot_data, 1.5, 1.5)
    stated = statements_without_distances(seen, LAYOUT)
    weighted = statements_with_distances(seen, LAYOUT, lens_of_stretch(0.0))
    weighted = weighted._replace(rows=stated.rows)  # without the distances
    assert lit_cost(seen, 0.0, weighted) < 0.5 * lit_cost(seen, 0.0, stated)


def test_the_slope_of_a_fall_off_is_that_of_its_cost(dot_data):
    seen = with_losses(dot_data, 0.1, 0.05)
    stated, step = statements_without_distances(seen, LAYOUT), 1e-4
    found = stated_equations(jnp.asarray(lens_of_stretch(0.1)), stated, LAYOUT)
    rise = lit_cost(seen, 0.1 + step) - lit_cost(seen, 0.1 - step)
    slope = 2 * float(found.gradient[STRETCH.start])
    assert slope == pytest.approx(rise / (2 * step), rel=1e-3)


def test_a_narrow_opening_far_from_focus_differs_from_a_wide_one_near_to_it(dot_data):
    """Both draw the same discs: statements alone say which it is."""
    blind = first_stage(dot_data, LAYOUT, lens_of(stated_defocus_mm(dot_data) / 0.85))
    narrow = blind.parameters.copy()
    narrow[RADII] = np.tile([0.85, 0.0], LAYOUT.rims)
    term_groups = candidate_term_groups(dot_data, LAYOUT, narrow[DEFOCUS][:2])
    start = replace(blind, parameters=narrow, mean=narrow.copy())
    start = set_priors(start, deviation_of(term_groups, LAYOUT, FINE))
    nothing = start.statements._replace(rows=0.0 * start.statements.rows)
    found = solve_stage(
        add_stated_distances(replace(start, statements=nothing)), 30, 1e-6
    )
    scale = found.parameters[DEFOCUS][:2] / stated_defocus_mm(dot_data)
    np.testing.assert_allclose(scale, 1.0, atol=0.04)
    assert found.parameters[RADII][::2].min() > 0.97


def test_a_beam_is_as_much_wider_as_fitted_defocus_is_larger(dot_data):
    """Between the f-number and the distances, nearer to these, whatever shift all
    focus distances have in common; narrower beams alike."""
    stated_mm = stated_defocus_mm(dot_data)
    none = stated_beam(lens_of(stated_mm), dot_data, LAYOUT).ratio
    for ratio in (1.06, 1 / 1.06):
        shifted = lens_of(ratio * stated_mm + 0.3)
        found = stated_beam(shifted, dot_data, LAYOUT).ratio
        assert 0.6 < np.log(found / none) / np.log(ratio) < 1.0


def test_a_beam_is_that_of_the_f_number_where_defocus_is_as_stated(dot_data):
    """Of an object at another distance: the same in millimetres is a sensor that was
    moved, whose rays spread with their tangents instead of their sines."""
    defocus_mm = lens_of(stated_defocus_mm(dot_data))
    fast = stated_beam(defocus_mm, dot_data, LAYOUT).ratio
    scale = dot_data.scale
    narrow = scale._replace(reference_sine=scale.reference_sine / 10)
    slow = stated_beam(defocus_mm, replace(dot_data, scale=narrow), LAYOUT).ratio
    mean_square = float(scale.reference_sine) ** 2 * 2 / 3
    assert slow == pytest.approx(1.0, abs=1e-3)
    assert 1.0 < fast < 1 + mean_square / 2 * 1.3


def test_a_beam_that_nobody_can_know_is_that_of_the_f_number(dot_data):
    """Nothing stated; one focus distance alone; near and far swapped."""
    stated_mm = stated_defocus_mm(dot_data)
    near, far = dot_data.groups
    silent = replace(dot_data, groups=(near, far._replace(focus_distance_mm=None)))
    assert stated_beam(lens_of(1.1 * stated_mm), silent, LAYOUT).ratio == 1.0
    assert stated_beam(lens_of(-1.1 * stated_mm), dot_data, LAYOUT).ratio == 1.0


def test_distances_that_contradict_the_f_number_hardly_count(dot_data):
    """Twice as much defocus is no beam twice as wide, but one that is less known."""
    stated_mm = stated_defocus_mm(dot_data)
    agreed, doubted = (
        stated_beam(lens_of(k * stated_mm), dot_data, LAYOUT) for k in (1, 2)
    )
    assert 1.0 < doubted.ratio < 1.5
    assert agreed.deviation < 0.6 * doubted.deviation < 0.6 * 0.06


def test_a_wider_beam_nearer_to_focus_draws_the_same_dots(dot_data):
    """Rays land where they did, but for defocus of third order in their sines."""
    stage = first_stage(dot_data, LAYOUT, lens_of(stated_defocus_mm(dot_data)))
    wider = stage_with_beam(stage, Beam(1.05, 0.0))

    def landing_mm(stage):
        aberration = aberration_of(
            jnp.asarray(stage.parameters), LAYOUT, stage.dot_data.scale
        )
        local = local_wavefront(jnp.zeros(2), jnp.zeros(()), aberration)
        defocus_mm = jnp.asarray(stage.parameters[DEFOCUS][0])
        u = jnp.array([0.3, 0.9])
        return np.asarray(landing_and_jacobian_mm(u, defocus_mm, local)[0])

    sine = float(wider.dot_data.scale.reference_sine)
    assert sine == pytest.approx(1.05 * float(dot_data.scale.reference_sine))
    np.testing.assert_allclose(landing_mm(wider), landing_mm(stage), rtol=0.1 * sine**2)
    assert abs(landing_mm(stage)).max() > 0.01

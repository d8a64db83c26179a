"""Where the fit begins: size and sign of defocus, and which dots it begins with."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from drawn_lens import LAYOUT, PLACES_MM, REFERENCE_MM, Seidel, Shot, photographed

from data_synth.lens import set_lens
from data_synth.paraxial import first_order
from data_synth.prescription import load_prescription
from lensfit.fitting.breathing import inverse_pupil_magnification
from lensfit.fitting.fall_off.illumination import FallOffFit
from lensfit.fitting.wavefront.dot_data import (
    FocusGroup,
    farthest_point_rows,
    rows_spread_over_takes,
    select_dots,
)
from lensfit.fitting.wavefront.start_values import (
    defocus_size_mm,
    first_defocus,
    first_parameters,
    first_rims,
    sharp_f_number,
)
from lensfit.optics.bernstein import bernstein
from lensfit.optics.paraxial import FirstOrder
from lensfit.psf.spot import AIRY_SIGMA, WAVELENGTH_MM


@pytest.fixture(scope="module")
def discs():
    lens = Seidel(defocus_mm=(0.4, -0.2))
    shots = [Shot(0, 0, 1600.0), Shot(0, 1, 1600.0), Shot(1, 1, 2600.0)]
    return photographed(lens, shots, rays=8000)


def test_the_size_of_defocus_is_that_of_the_disc(discs):
    np.testing.assert_allclose(defocus_size_mm(discs), [0.4, 0.2], rtol=0.03)


def test_its_sign_is_that_of_the_stated_distances(discs):
    """The chart beyond the focus distance: the sensor lies behind its image."""
    first = first_defocus(discs)
    np.testing.assert_allclose(first.value_mm, [0.4, -0.2], rtol=0.03)
    assert first.side_stated.all()


def test_without_distances_the_sign_is_unknown(discs):
    silent = replace(discs, groups=(FocusGroup(None, None, "a"), discs.groups[1]))
    first = first_defocus(silent)
    np.testing.assert_allclose(first.value_mm, [0.4, -0.2], rtol=0.03)
    np.testing.assert_array_equal(first.side_stated, [False, True])


def test_a_chart_stated_in_focus_is_taken_to_be(discs):
    """What is seen is then aberrations, not defocus."""
    focused = FocusGroup(REFERENCE_MM, REFERENCE_MM, "")
    first = first_defocus(replace(discs, groups=(focused, discs.groups[1])))
    assert first.side_stated.all()
    assert abs(first.value_mm[0]) < 1e-9


def slanted(f_number: float, sigma_mm: float, depth_mm: float = 3.0):
    """Half of the dots' sharp images before the others', by twice `depth_mm`; of a thin
    lens of 50 mm, whose dots are as blurred as at this f-number or by a sigma."""
    image_mm = np.resize([50 + depth_mm, 50 - depth_mm], 8)
    radius_mm = depth_mm / (2 * f_number)
    dots = SimpleNamespace(
        vergence=1 / (50 + 50**2 / (image_mm - 40)),
        variance_mm2=np.zeros((8, 2)),
        sampled_ellipse_mm=np.zeros((8, 2, 2)),
        cell_mm=np.full((8, 2), 0.01),
        broad=None,
    )
    diameter_mm = 4 * max(radius_mm / 2, sigma_mm)
    return SimpleNamespace(
        first_order=FirstOrder(*map(jnp.asarray, (50.0, 1.0, 0.0))),
        dots=dots,
        diameter_mm=np.full(8, diameter_mm),
        f_numbers=(4.0,),
        photographs=(None,),
        take=np.zeros(8, int),
    )


def test_a_chart_seen_at_a_slant_is_as_deep_as_its_dots_are_sharp():
    dot_data: Any = slanted(11.0, 0.0)
    assert sharp_f_number(dot_data) == pytest.approx(11.0, rel=1e-6)


def test_a_level_chart_keeps_the_unit():
    dot_data: Any = slanted(11.0, 0.02, depth_mm=0.0)
    assert sharp_f_number(dot_data) == 4.0


def test_an_opening_that_diffraction_would_blur_more_is_none():
    dot_data: Any = slanted(500.0, 0.01)
    airy_mm = AIRY_SIGMA * WAVELENGTH_MM * sharp_f_number(dot_data)
    assert airy_mm == pytest.approx(0.005)


def test_the_first_lens_is_perfect_but_defocused_and_clipped(discs):
    first = first_parameters(discs, LAYOUT, np.array([0.4, -0.2]))
    assert not np.any(first[LAYOUT.blocks["coefficients"]])
    np.testing.assert_allclose(first[LAYOUT.blocks["defocus"]], [0.4, -0.2, 0.0])
    assert np.all(first[LAYOUT.blocks["rim_radius"]][::2] > 1)


def _breathing(name: str, focal_mm: float) -> tuple[float, float]:
    """Pupil magnification that breathing of a traced lens tells, and the exit pupil's
    distance over the principal distance."""
    prescription = load_prescription(name)
    known = []
    for focus_mm in (28 * focal_mm, 40 * focal_mm, 70 * focal_mm):
        lens = set_lens(
            prescription, focal_length_mm=focal_mm, focus_distance_mm=focus_mm
        )
        optics = first_order(lens.surfaces, 540.0)
        ratio = optics.exit_pupil_magnification / optics.entrance_pupil_magnification
        principal_mm = -optics.exit_pupil_z_mm / ratio
        known.append((principal_mm, 1 / (focus_mm + optics.entrance_pupil_z_mm)))
    principal_mm, per_mm = np.array(known).T
    inverse = inverse_pupil_magnification(principal_mm, per_mm, focal_mm, 0.03)
    return 1 / inverse, ratio


@pytest.mark.parametrize(
    ("name", "focal_mm", "tolerance"),
    [
        ("kreitzer_135", 135.0, 0.03),
        ("canon_14", 14.2, 0.03),
        ("biotar_50", 50.0, 0.03),
        # Elements move against each other.
        ("itoh_zoom", 41.5, 0.6),
        ("nikon_zoom_200", 80.0, 0.3),
        ("arri_100", 100.0, 0.9),
    ],
)
def test_the_exit_pupil_starts_where_breathing_tells(discs, name, focal_mm, tolerance):
    """In units in which a principal distance is usual, by its logarithm."""
    magnification, traced = _breathing(name, focal_mm)
    optics = FirstOrder(*map(jnp.asarray, (focal_mm, magnification, 0.0)))
    known = replace(discs, first_order=optics)
    first = first_parameters(known, LAYOUT, np.array([0.4, -0.2]))
    found, bend = first[LAYOUT.blocks["exit_pupil"]]
    assert found == pytest.approx(np.log(traced), abs=tolerance)
    assert bend == 0


@pytest.mark.parametrize("truth", [(1.1, 0.8), (1.6, 0.2)])
def test_rims_begin_where_they_explain_the_fall_off(truth):
    """Fall-off of two opposite rims, counted over a grid of the opening."""
    h = np.linspace(0.02, 1.0, 40)
    light = np.array([_open_share(*truth, one) for one in h])
    found = first_rims(_fall_off(h, light), 20.0)
    again = np.array([_open_share(*found, one) for one in h])
    np.testing.assert_allclose(again, light, atol=0.06)


def _open_share(radius: float, shift: float, h: float) -> float:
    x, y = np.meshgrid(np.linspace(-1, 1, 301), np.linspace(-1, 1, 301))
    disc = np.hypot(x, y) < 1
    clear = disc.copy()
    for side in (-shift, shift):
        clear &= np.hypot(x + side * h, y) < radius
    return clear.sum() / disc.sum()


def _fall_off(h: np.ndarray, light: np.ndarray) -> FallOffFit:
    """Least squares for the Bernstein form of the logarithm."""
    terms = 5
    basis = bernstein(h**2, terms)
    control = np.linalg.lstsq(basis, -np.log(light), rcond=None)[0]
    return FallOffFit(2.0, np.tile(control, (3, 1)), 20.0, np.zeros((3, 5, 5)))


def test_dots_are_chosen_far_apart():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (200, 2))
    among = np.arange(0, 200, 2)
    found = farthest_point_rows(points, among, 9)
    assert len(set(found)) == 9
    assert set(found) <= set(among)
    apart = np.hypot(*(points[found][:, None] - points[found][None]).T)
    assert apart[np.triu_indices(9, 1)].min() > 0.5
    np.testing.assert_array_equal(farthest_point_rows(points, among[:5], 9), among[:5])


def test_every_take_keeps_its_dots(discs):
    rows = rows_spread_over_takes(discs, 4)
    few = select_dots(discs, rows)
    assert [int(np.sum(few.take == k)) for k in range(3)] == [4, 4, 4]
    np.testing.assert_array_equal(few.light, discs.light[rows])
    np.testing.assert_array_equal(few.dots.group, discs.dots.group[rows])
    assert len(PLACES_MM) > 4

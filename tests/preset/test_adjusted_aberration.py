"""Gains of aberrations: what each changes in the landing of rays, and that it changes
nothing else."""

import jax
import numpy as np
import pytest
from adjusted_lenses import (
    CORNER_MM,
    FOCAL_TERMS,
    TERMS,
    disc_points,
    focal_surfaces_um,
    ideal,
    landings_um,
    measured,
    measured_preset,
    rms_spot_um,
)

from lensfit.optics.spectrum import chromatic_coordinate

H = (0.6, 0.35)
U = disc_points(5, 9)
FOCAL = measured_preset(*FOCAL_TERMS)
RADII = (0.2, 0.55, 0.9, 1.0)
SPOTS = (
    "field_curvature",
    "astigmatism_sagittal",
    "astigmatism_tangential",
    "coma",
    "spherical",
    "other_aberrations",
)


@pytest.mark.parametrize("gain", [0.0, -1.0, 2.5])
@pytest.mark.parametrize("chromatic", [0.0, -1.0])
def test_gains_of_focal_surfaces_move_them_one_by_one(gain, chromatic):
    """The medial surface from its place on the axis, the others from the medial one."""
    knobs = (
        "field_curvature_gain",
        "astigmatism_tangential_gain",
        "astigmatism_sagittal_gain",
    )
    axis, _ = focal_surfaces_um(measured(FOCAL), 0.0, chromatic)
    for radius in RADII:
        t, s = focal_surfaces_um(measured(FOCAL), radius, chromatic)
        medial = (t + s) / 2
        expected = {
            knobs[0]: (
                axis + gain * (medial - axis) + t - medial,
                axis + gain * (medial - axis) + s - medial,
            ),
            knobs[1]: (medial + gain * (t - medial), s),
            knobs[2]: (t, medial + gain * (s - medial)),
        }
        for name in knobs:
            lens = measured(FOCAL, **{name: gain})
            found = focal_surfaces_um(lens, radius, chromatic)
            np.testing.assert_allclose(found, expected[name], rtol=1e-9, atol=1e-9)
            on_axis = focal_surfaces_um(lens, 0.0, chromatic)
            np.testing.assert_allclose(on_axis, axis, rtol=1e-9)


def test_without_curvature_and_astigmatism_the_field_is_flat():
    off = dict.fromkeys(
        (
            "field_curvature_gain",
            "astigmatism_tangential_gain",
            "astigmatism_sagittal_gain",
        ),
        0,
    )
    lens = measured(FOCAL, **off)
    axis = focal_surfaces_um(lens, 0.0)
    for radius in RADII:
        found = focal_surfaces_um(lens, radius)
        np.testing.assert_allclose(found, axis, rtol=1e-9)


def test_coma_is_what_makes_a_spot_lopsided_along_the_field():
    """Without it and trefoil a centred lens' spot is the same on both sides."""
    for knobs, symmetric in (
        ({}, False),
        ({"coma_gain": 0}, False),
        ({"coma_gain": 0, "other_aberrations_gain": 0}, True),
    ):
        lens = measured(**knobs)
        there = landings_um(lens, (0.8, 0), U)
        across = landings_um(lens, (0.8, 0), U * [1, -1])
        np.testing.assert_allclose(across, there * [1, -1], atol=1e-9)
        along = landings_um(lens, (0.8, 0), U * [-1, 1])
        assert np.allclose(along, there * [-1, 1], atol=1e-9) == symmetric


@pytest.mark.parametrize(
    ("name", "is_in"),
    [
        ("coma", lambda t: t.order_u == 1),
        ("spherical", lambda t: t.order_u == 0 and t.degree > 2),
        ("other_aberrations", lambda t: (t.degree, t.order_u) in {(3, 3), (4, 2)}),
    ],
)
@pytest.mark.parametrize("chromatic", [0.0, -1.0])
def test_a_gain_multiplies_what_its_aberration_does_to_rays(name, is_in, chromatic):
    """And nothing else: rays move by gain - 1 times what it moved them."""
    own = [
        t
        for t, o in zip(TERMS, measured().blur.aberration.terms, strict=True)
        if is_in(o)
    ]
    base = landings_um(measured(), H, U, chromatic)
    alone = landings_um(measured(measured_preset(*own)), H, U, chromatic)
    assert np.abs(alone).max() > 0.1
    for gain in (0.0, 2.0, -1.5):
        found = landings_um(measured(**{f"{name}_gain": gain}), H, U, chromatic)
        np.testing.assert_allclose(found, base + (gain - 1) * alone, atol=1e-9)


@pytest.mark.parametrize("name", SPOTS)
def test_a_gain_leaves_the_bits_of_other_aberrations(name):
    base, lens = measured().blur.aberration, measured(**{f"{name}_gain": 0.5})
    found = lens.blur.aberration
    families = {
        "field_curvature": lambda t: (t.degree, t.order_u) == (2, 0),
        "astigmatism_sagittal": lambda t: t.degree == 2,
        "astigmatism_tangential": lambda t: t.degree == 2,
        "coma": lambda t: t.order_u == 1,
        "spherical": lambda t: t.order_u == 0 and t.degree > 2,
        "other_aberrations": lambda t: (t.degree, t.order_u) in {(3, 3), (4, 2)},
    }
    was = dict(zip(base.terms, np.asarray(base.coefficients_um), strict=True))
    now = dict(zip(found.terms, np.asarray(found.coefficients_um), strict=True))
    kept = [t for t in was if not families[name](t)]
    assert len(kept) > 3
    assert [now[t] for t in kept] == [was[t] for t in kept]
    assert any(now[t] != was[t] for t in was if families[name](t))


@pytest.mark.parametrize(
    ("name", "modes"),
    [
        ("coma", {(3, 1), (5, 1)}),
        ("spherical", {(4, 0), (6, 0)}),
        ("other_aberrations", {(3, 3), (4, 2)}),
    ],
)
@pytest.mark.parametrize("um", [8.0, -3.0])
def test_a_stated_size_is_the_largest_spot_over_the_field(name, modes, um):
    own = [t for t in TERMS if (t.degree, t.order) in modes]
    for lens in (
        measured(measured_preset(*own), **{f"{name}_um": um}),
        ideal(**{f"{name}_um": um}),
    ):
        edge = CORNER_MM / float(lens.blur.aberration.field_radius_mm)
        field = np.linspace(0, edge, 25)
        found = max(rms_spot_um(lens, (radius, 0)) for radius in field)
        np.testing.assert_allclose(found, abs(um), rtol=0.01)


def test_a_stated_size_keeps_the_proportion_of_orders_and_its_sign_turns_it_round():
    was = np.asarray(measured().blur.aberration.coefficients_um)
    coma = [t.order_u == 1 for t in measured().blur.aberration.terms]
    now = np.asarray(measured(coma_um=10.0).blur.aberration.coefficients_um)
    back = np.asarray(measured(coma_um=-10.0).blur.aberration.coefficients_um)
    ratio = now[coma] / was[coma]
    np.testing.assert_allclose(ratio, ratio[0])
    np.testing.assert_allclose(back[coma], -now[coma])


def test_gains_multiply_stated_sizes():
    once = landings_um(ideal(coma_um=4.0), H, U)
    twice = landings_um(ideal(coma_um=4.0, coma_gain=2.0), H, U)
    np.testing.assert_allclose(twice, 2 * once)
    assert not landings_um(ideal(coma_um=4.0, coma_gain=0.0), H, U).any()


def test_stated_focal_surfaces_of_an_ideal_lens_bend_alone():
    """An rms spot of a um is a slope of sqrt(2) a over the opening; positive in front
    of the sensor, where an object nearer than in focus would be blurred alike."""
    edge = CORNER_MM / float(ideal().perfect_blur().aberration.field_radius_mm)
    slope = 2**0.5 * 5
    for knobs, expected in (
        ({"field_curvature_um": 5.0}, (slope, slope)),
        ({"astigmatism_tangential_um": 5.0}, (slope, 0)),
        ({"astigmatism_sagittal_um": -5.0}, (0, -slope)),
    ):
        found = focal_surfaces_um(ideal(**knobs), edge)
        np.testing.assert_allclose(found, expected, atol=1e-6)
        half = focal_surfaces_um(ideal(**knobs), edge / 2)
        np.testing.assert_allclose(half, np.array(expected) / 4, atol=1e-6)


def test_without_axial_colour_all_colours_focus_alike():
    lens = measured(FOCAL, axial_colour_gain=0, chromatic_gain=1)
    for radius in (0.0, 0.7):
        green = focal_surfaces_um(lens, radius)
        t, s = focal_surfaces_um(lens, radius, -1.0)
        np.testing.assert_allclose((t + s) / 2, np.mean(green), rtol=1e-9)
    doubled = measured(FOCAL, axial_colour_gain=2)
    was, now = (
        np.subtract(*(focal_surfaces_um(one, 0.0, w)[0] for w in (-1.0, 0.0)))
        for one in (measured(FOCAL), doubled)
    )
    np.testing.assert_allclose(now, 2 * was)


def test_without_chromatic_aberration_rays_of_all_colours_land_together():
    lens = measured(chromatic_gain=0)
    green, blue = (landings_um(lens, H, U, w) for w in (0.0, -1.0))
    np.testing.assert_array_equal(blue, green)
    point = np.array([[9.0, 6.0]])
    for channel in ("r", "b"):
        np.testing.assert_array_equal(
            lens.distorted_from_undistorted(point, channel),
            lens.distorted_from_undistorted(point, "g"),
        )


def test_stated_axial_colour_is_the_spot_of_the_colour_that_departs_most():
    for lens in (ideal(axial_colour_um=6.0), measured(FOCAL, axial_colour_um=6.0)):
        w = np.asarray(chromatic_coordinate(lens.blur.bands.wavelengths_nm)).mean(1)
        green = focal_surfaces_um(lens, 0.0)[0]
        away = [
            (focal_surfaces_um(lens, 0.0, c)[0] - green) / 2**0.5 for c in w[[0, 2]]
        ]
        np.testing.assert_allclose(max(away, key=abs), 6.0, rtol=1e-6)


def test_turning_an_aberration_down_to_what_it_was_changes_no_program():
    """Gains keep the terms, so that the compiled kernels serve."""
    base, turned = measured().blur, measured(coma_gain=0.3, spherical_gain=2).blur
    assert jax.tree.structure(base) == jax.tree.structure(turned)

"""A fitted wavefront as a preset: the lens shows what the fit showed."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lensfit.fitting.entrance_pupil import EntrancePupil
from lensfit.fitting.select import TermDecision
from lensfit.fitting.wavefront.dot_arrays import Dots, FocusRange
from lensfit.fitting.wavefront.dot_data import Beam, FocusGroup
from lensfit.fitting.wavefront.misfit import Misfit
from lensfit.fitting.wavefront.parameters import Layout, Scale
from lensfit.fitting.wavefront.rays import spot_and_pullback
from lensfit.fitting.wavefront.shapes import colours_of
from lensfit.fitting.wavefront.term_groups import (
    FINE,
    TermGroup,
    terms_that_change_with_focus,
)
from lensfit.optics.distortion import no_distortion
from lensfit.optics.paraxial import FirstOrder, rim_sine
from lensfit.optics.spectrum import bands
from lensfit.optics.terms import rotational_terms
from lensfit.preset.blocks import Camera, Covariance, Distortion, Projection
from lensfit.preset.entry import Entry, Quality
from lensfit.preset.lens_of_entry import lens_of_entry
from lensfit.psf.spot import (
    diffraction_variance_mm2,
    image_of,
    profile_of,
)
from lensfit.workflow.calibration.blur_entries import blur_of
from lensfit.workflow.calibration.fit_facts import blur_facts, blur_terms

LAYOUT = Layout(
    rotational_terms(5),
    rotational_terms(3),
    groups=3,
    stops=1,
    rims=2,
    focus_terms=terms_that_change_with_focus(rotational_terms(3)),
)
BLOCKS = LAYOUT.blocks
REFERENCE_MM, PRINCIPAL_MM = 1500.0, 50.0
BEAM = Beam(1.04, 0.02)
F_NUMBERS = (2.0, 4.0)
POINT = (9.0, -6.0)
PITCH_MM, SIZE_PX = 0.006, 64
CHANNELS = ("r", "g", "b")


def parameters() -> np.ndarray:
    """A poor lens with everything in use."""
    rng = np.random.default_rng(3)
    found = np.zeros(LAYOUT.size)
    found[BLOCKS["coefficients"]] = rng.normal(0, 8.0, len(LAYOUT.terms))
    found[BLOCKS["coefficients"].start] = 0.0
    found[BLOCKS["colour"]] = rng.normal(0, 4.0, 2 * len(LAYOUT.colour_terms))
    found[BLOCKS["focus_change"]] = [6.0, -8.0, 5.0, -7.0]
    found[BLOCKS["defocus"]] = [0.15, -0.2, 0.1]
    found[BLOCKS["exit_pupil"]] = [0.2, 0.05]
    found[BLOCKS["band_width"]] = [0.15]
    found[BLOCKS["rim_shift"]] = [0.5, 0.05, -0.6, 0.0]
    found[BLOCKS["rim_radius"]] = [1.1, 0.0, 1.2, 0.0]
    found[BLOCKS["stretch"]] = [-0.1, 0.0, -0.03, 0.0]
    found[BLOCKS["iris"]] = [0.02, 0.3, 0.2]
    found[BLOCKS["stop_ratio"]] = [0.06]
    return found


def image_shift(distance_mm: float) -> float:
    """Of a thin lens that stays where its principal distance has it, by Newton."""
    focal = 1 / (1 / PRINCIPAL_MM + 1 / (REFERENCE_MM - PRINCIPAL_MM))
    return focal**2 / (distance_mm - PRINCIPAL_MM - focal)


def fit_of(
    focus_mm: tuple[float | None, ...],
    exit_pupil: bool = True,
    principal_mm: tuple[float, ...] = (PRINCIPAL_MM,),
):
    """What blur_of reads of a fit whose groups were focused at these distances.

    `principal_mm`: of the states of the first groups, as the fit had them.
    """
    focal = 1 / (1 / PRINCIPAL_MM + 1 / (REFERENCE_MM - PRINCIPAL_MM))
    first = FirstOrder(*(jnp.asarray(n) for n in (focal, 1.0, PRINCIPAL_MM)))
    sine = rim_sine(first, jnp.asarray(F_NUMBERS[0]), jnp.asarray(REFERENCE_MM))
    stated = focus_mm[0] is not None
    groups = tuple(
        FocusGroup(f, REFERENCE_MM if stated else None, "" if stated else f"take {k}")
        for k, f in enumerate(focus_mm)
    )
    photographs = tuple(
        SimpleNamespace(
            take=SimpleNamespace(
                name=f"take {k}",
                focus_distance_mm=focus_mm[min(k, len(focus_mm) - 1)],
                observations=SimpleNamespace(are_corners=k == 2, are_lines=False),
            ),
            distortion=no_distortion((*principal_mm, *3 * [PRINCIPAL_MM])[k], 18.0),
        )
        for k in range(3)
    )
    dot_data = SimpleNamespace(
        dots=SimpleNamespace(sections=None),
        scale=Scale(jnp.asarray(18.0), BEAM.ratio * sine, jnp.asarray(PRINCIPAL_MM)),
        beam=BEAM,
        groups=groups,
        f_numbers=F_NUMBERS,
        reference_distance_mm=REFERENCE_MM,
        focus=FocusRange.of(focus_mm[0], focus_mm),
        first_order=first,
        photographs=photographs,
        take=np.repeat(np.arange(3), 4),
    )
    numbers = parameters()
    if not exit_pupil:
        numbers[BLOCKS["exit_pupil"]] = 0.0
    stage = SimpleNamespace(
        dot_data=dot_data, layout=LAYOUT, parameters=numbers, blades=7
    )
    named = [("defocus", "defocus"), ("third_order", "coefficients")]
    named += [("exit_pupil", "exit_pupil")] * exit_pupil
    term_groups = tuple(
        TermGroup(name, tuple(range(BLOCKS[b].start, BLOCKS[b].stop)), (), FINE)
        for name, b in named
    )
    return SimpleNamespace(
        dot_data=dot_data,
        stage=stage,
        term_groups=term_groups,
        has=lambda name: any(one.name == name for one in term_groups),
        term_decisions=(
            TermDecision("exit_pupil", exit_pupil, 30.0, 0.1),
            TermDecision("fifth_order", False, -8.0, 0.0),
        ),
        total_covariance=np.diag(np.full(LAYOUT.size, 0.25)),
        undetermined_term_groups=("third_order",),
        sign_known=True,
        mirrored=False,
        extrapolation_notes=("at f/2 alone",),
        misfit=Misfit(np.array([0.02, 0.03, 0.04]), 0.035, (0.03, 0.04, None)),
        converged=True,
    )


def lens_psf(wavefront, group: int, f_number: float, principal_mm: float) -> np.ndarray:
    """Of the preset's lens at the state of a group: (3, rows, columns)."""
    focus_mm = wavefront.dot_data.groups[group].focus_distance_mm
    state = SimpleNamespace(
        distortion=no_distortion(principal_mm, 18.0),
        pupil=EntrancePupil(principal_mm, measured=False),
        focus_distance_mm=focus_mm,
    )
    entry = Entry(
        focal_length_mm=50.0,
        focus_distance_mm=focus_mm,
        projection=Projection(principal_mm, (0.0, 0.0), principal_mm),
        distortion=Distortion("rectilinear", 18.0, 1.0, (-1.0, -1.0, 1.0, 1.0)),
        lateral_colour=None,
        fall_off=(),
        terms=(),
        covariance=Covariance((), (), ()),
        quality=Quality(0.02, 0.02, 100, 100, 3, 0.02, 1e-9),
        blur=blur_of(state, wavefront),
    )
    camera = Camera(None, 36.0, 24.0, 6000, 4000)
    lens = lens_of_entry(entry, camera, f_number)
    return np.stack(
        [
            lens.psf(
                POINT, REFERENCE_MM, channel, pixel_pitch_mm=PITCH_MM,
                size_px=SIZE_PX, tolerance=0.005,
            )
            for channel in CHANNELS
        ]
    )  # fmt: skip


@jax.jit
def _spots(numbers, dot, colours):
    """Of all channels."""

    def one(colour):
        return spot_and_pullback(
            numbers, dot, colour, LAYOUT, _spots_scale(), 3 * 4096
        )[0]

    return jax.vmap(one)(colours)


def _spots_scale() -> Scale:
    return fit_of((1400.0, 1600.0, 1500.0)).dot_data.scale


def fitted_image(wavefront, group: int, stop: int, principal_mm: float) -> np.ndarray:
    """What the fit thinks of a point there, row 0 on top: (3, rows, columns)."""
    vergence = jnp.asarray(1 / (REFERENCE_MM - PRINCIPAL_MM))
    dot = Dots(
        field_mm=jnp.asarray(POINT),
        principal_distance_ratio=jnp.asarray(principal_mm / PRINCIPAL_MM),
        focus=jnp.asarray(_focus_coordinate(wavefront, group)),
        group=jnp.asarray(group),
        stop=jnp.asarray(stop),
        stop_radius=jnp.asarray(F_NUMBERS[0] / F_NUMBERS[stop]),
        blades=jnp.asarray(7.0 if stop else 0.0),
        slope=jnp.zeros(2),
        pupil_per_sine_mm=jnp.zeros((2, 2)),
        vergence=vergence,
        reference=vergence,
        lateral_mm=jnp.zeros((3, 3, 2)),
        sampled_ellipse_mm=jnp.zeros((2, 2)),
        variance_mm2=jnp.zeros(2),
        cell_mm=jnp.full(2, PITCH_MM),
    )
    parameters = jnp.asarray(wavefront.stage.parameters)
    colours = colours_of(parameters, dot, bands(3).wavelengths_nm, LAYOUT)
    spots = _spots(parameters, dot, colours)
    pitch = jnp.full(2, PITCH_MM)
    variance = diffraction_variance_mm2(jnp.asarray(F_NUMBERS[stop]))
    found = []
    for k in range(3):
        one = jax.tree.map(lambda a, k=k: a[k], spots)
        corner = -SIZE_PX / 2 * pitch
        patch = image_of(one, profile_of(one, corner, pitch, SIZE_PX, variance))
        found.append(np.asarray(patch / jnp.sum(patch)))
    return np.stack(found)


def _focus_coordinate(wavefront, group: int) -> float:
    dot_data = wavefront.dot_data
    return dot_data.focus.coordinate(dot_data.groups[group].focus_distance_mm)


def far_from(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


@pytest.mark.slow
@pytest.mark.parametrize("exit_pupil", [True, False])
@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("stop", [0, 1])
def test_the_lens_shows_what_the_fit_showed(stop, stated, exit_pupil):
    """At the state that was photographed, colour, blades and stop ratio included."""
    focus = (1400.0, 1650.0, 1480.0) if stated else (None,)
    wavefront = fit_of(focus, exit_pupil)
    shown = lens_psf(wavefront, 0, F_NUMBERS[stop], PRINCIPAL_MM)
    wanted = fitted_image(wavefront, 0, stop, PRINCIPAL_MM)
    assert far_from(shown, wanted) < 0.04
    assert far_from(wanted[[2, 1, 0]], wanted) > 0.1


def test_every_state_has_its_own_defocus_and_magnification():
    """Focused nearer, the whole lens moved out: its principal distance is longer."""
    wavefront = fit_of((1400.0, 1650.0, 1480.0), principal_mm=(50.2, 49.8))
    for group, principal_mm in ((0, 50.2), (1, 49.8)):
        shown = lens_psf(wavefront, group, 2.0, principal_mm)
        assert far_from(shown, fitted_image(wavefront, group, 0, principal_mm)) < 0.05
        other = fitted_image(wavefront, 1 - group, 0, principal_mm)
        assert far_from(shown, other) > 0.3


def test_focus_is_a_coordinate_in_vergence():
    """No more than 1 from the reference, and none where nothing is stated."""
    focus = FocusRange.of(1500.0, (1000.0, 1500.0, 3000.0, None))
    assert focus.coordinate(1500.0) == 0
    assert focus.coordinate(1000.0) == 1
    assert focus.coordinate(3000.0) == pytest.approx(-1)
    assert focus.coordinate(1200.0) == pytest.approx(0.5)
    assert focus.coordinate(300.0) == 1
    assert focus.coordinate(None) == 0
    assert FocusRange.of(None, (None, 900.0)).coordinate(900.0) == 0
    assert FocusRange.of(900.0, (900.0, 900.0)).coordinate(500.0) == 0


def test_a_principal_distance_measured_anew_changes_no_spot():
    """By chief rays, after the fit: millimetres on the sensor stay what they were."""
    wavefront = fit_of((1400.0, 1650.0, 1480.0))
    wanted = fitted_image(wavefront, 0, 0, PRINCIPAL_MM)
    assert far_from(lens_psf(wavefront, 0, 2.0, 1.06 * PRINCIPAL_MM), wanted) < 0.05


def test_what_was_assumed_is_said():
    state = SimpleNamespace(
        distortion=no_distortion(PRINCIPAL_MM, 18.0),
        pupil=EntrancePupil(PRINCIPAL_MM, measured=False),
        focus_distance_mm=1400.0,
    )
    seen, assumed = (
        blur_of(state, fit_of((1400.0, 1650.0, 1480.0), known))
        for known in (True, False)
    )
    assert seen.assumed == ()
    assert seen.pupil_magnification == pytest.approx(np.exp(0.2))
    assert seen.exit_pupil_distance_mm == pytest.approx(PRINCIPAL_MM * np.exp(0.2))
    assert assumed.assumed == ("exit_pupil_distance_mm",)
    of_one_distance = blur_of(state, fit_of((1400.0, 1400.0, 1400.0), False))
    assert of_one_distance.assumed == ("pupil_magnification", "exit_pupil_distance_mm")
    assert assumed.pupil_magnification == 1.0
    assert seen.round_f_number == 2.0
    assert [stop.f_number for stop in seen.stops] == [2.0, 4.0]
    ratios = [stop.radius_ratio for stop in assumed.stops]
    assert ratios[1] / ratios[0] == pytest.approx(np.exp(0.06))


def test_the_report_lists_what_was_kept_and_what_was_left():
    wavefront = fit_of((1400.0, 1650.0, 1480.0))
    terms = {term["name"]: term for term in blur_terms(wavefront)}
    left = terms["blur_fifth_order"]
    assert not left["kept"]
    assert left["value"] is None
    defocus = terms["blur_defocus"]
    assert defocus["value"] == [0.15, -0.2, 0.1]
    assert defocus["standard_deviation"] == [0.5, 0.5, 0.5]
    assert defocus["unit"] == "mm"
    assert "determine it weakly" in terms["blur_third_order"]["reason"]
    assert "determine it weakly" not in defocus["reason"]


def test_the_report_states_every_take_and_every_defocus():
    facts = blur_facts(fit_of((1400.0, 1650.0, 1480.0)), {"take 1": "<svg/>"})
    assert [take["misfit"] for take in facts["takes"]] == [0.02, 0.03, 0.04]
    assert [take["held_out_misfit"] for take in facts["takes"]] == [0.03, 0.04, None]
    assert [take["picture"] for take in facts["takes"]] == [None, "<svg/>", None]
    assert [take["dots"] for take in facts["takes"]] == [4, 4, 4]
    assert [t["targets"] for t in facts["takes"]] == ["dots", "dots", "corners"]
    assert [g["focus_distance_mm"] for g in facts["defocus"]] == [1400, 1650, 1480]
    assert [g["defocus_mm"] for g in facts["defocus"]] == [0.15, -0.2, 0.1]
    # Besides what all have in common, known better than that is.
    told = [g["from_stated"] for g in facts["defocus"]]
    besides = np.array([one["defocus_mm"] for one in told])
    np.testing.assert_allclose(np.diff(besides), [-0.35, 0.3])
    stated = [image_shift(f) - image_shift(REFERENCE_MM) for f in (1400, 1650, 1480)]
    assert np.mean(besides) == pytest.approx(np.mean(stated), rel=1e-6)
    deviation = [one["standard_deviation_mm"] for one in told]
    np.testing.assert_allclose(deviation, np.sqrt(0.25 * 2 / 3))
    unsaid = blur_facts(fit_of((None,)), {})["defocus"]
    assert [g["from_stated"] for g in unsaid] == [None]
    assert facts["blades"] == 7

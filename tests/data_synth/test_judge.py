"""The judge judged: the tracer itself scores nothing, wrong lenses are found out."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from judged_lenses import FlippedLens, TracedLens

from data_synth.judge import geometry_figures, judge, thin_lens_figures
from data_synth.judge_spots import best_shift, mirrored_distance_mm, psf_error
from data_synth.lens import set_lens
from data_synth.prescription import load_prescription
from data_synth.psf_truth import (
    geometry_truth,
    read_truth,
    settings_for,
    wavefront_truth,
    write_truth,
)
from data_synth.sensor import Frame, camera_bands
from data_synth.thin_lens import ThinLens
from lensfit.errors import PresetError

FRAME = Frame((512, 384), (28.0, 21.0))
CHART_MM = 1120.0
BANDS = camera_bands(1)
NEAR_MM = 700.0
EVERY = 9


def traced(f_number, focus_mm):
    lens = load_prescription("nikkor_28")
    return set_lens(lens, f_number=f_number, focus_distance_mm=focus_mm)


def exact(f_number, focus_mm):
    return TracedLens(traced(f_number, focus_mm), BANDS, CHART_MM)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truth")
    seen = tuple((2.8, focus_mm, CHART_MM) for focus_mm in (CHART_MM, NEAR_MM))
    truth = wavefront_truth(traced, FRAME, BANDS, settings_for(seen), 28.0)
    write_truth(folder, truth)
    return folder


@pytest.fixture(scope="module")
def of_the_tracer(folder):
    return judge(exact, folder, every=EVERY)


@pytest.mark.slow
def test_the_tracer_itself_scores_nothing(of_the_tracer):
    figures = of_the_tracer
    assert max(figures["chief_ray_px"].values()) < 1e-9
    assert max(figures["lateral_colour_px"].values()) < 1e-9
    assert max(figures["illumination_worst"].values()) < 1e-4
    for part in ("all", "unseen_stop", "unseen_depth"):
        assert figures["psf"][part]["p90"] < 5e-3
    assert len(figures["psf"]["by_setting"]) == 2 + 2 + 1
    assert figures["defocus_sign"] == "right"
    assert figures["flags"] == []


@pytest.mark.slow
def test_geometry_alone_is_judged_like_the_whole(folder, of_the_tracer):
    setting = (2.8, CHART_MM, CHART_MM)
    alone = geometry_truth(traced, FRAME, BANDS, setting, 28.0)
    whole = read_truth(folder)
    np.testing.assert_allclose(alone.chief_mm[0], whole.chief_mm[0], atol=1e-12)
    np.testing.assert_allclose(alone.light[0], whole.light[0], atol=1e-12)
    figures = geometry_figures(exact, alone)
    assert max(figures["chief_ray_px"].values()) < 1e-9
    assert max(figures["illumination_worst"].values()) < 1e-4
    thin = geometry_figures(lambda *_: ThinLens(28.0, 2.8, CHART_MM), alone)
    assert thin["chief_ray_px"]["1120"] > 0.2
    kept = ("chief_ray_px", "lateral_colour_px", "illumination_worst", "flags")
    assert {key: of_the_tracer[key] for key in kept} == geometry_figures(exact, whole)


def test_a_thin_lens_scores_badly(folder):
    figures = thin_lens_figures(folder)
    assert figures["chief_ray_px"]["1120"] > 0.2
    assert figures["lateral_colour_px"]["b-g"] > 0.02
    assert figures["illumination_worst"]["f2.8_focus1120"] > 0.1
    assert figures["psf"]["all"]["median"] > 0.1
    assert figures["defocus_sign"] == "undecided"


@pytest.mark.slow
def test_a_wrong_sign_of_defocus_is_found(folder, of_the_tracer):
    def flipped(f_number, focus_mm):
        return FlippedLens(exact(f_number, focus_mm), focus_mm)

    figures = judge(flipped, folder, every=EVERY)
    assert figures["defocus_sign"] == "wrong"
    assert figures["psf"]["all"]["p90"] > 20 * of_the_tracer["psf"]["all"]["p90"]
    assert figures["chief_ray_px"] == of_the_tracer["chief_ray_px"]


@dataclasses.dataclass(frozen=True)
class Folding(ThinLens):
    """Its distortion turns back before the corner, and its light goes out."""

    def project(self, object_points_mm, channel="g"):
        place = super().project(object_points_mm, channel)
        return place * (1 - 2.2e-3 * (place**2).sum(axis=1, keepdims=True))

    def relative_illumination(self, points_mm, channel="g"):
        radius = np.hypot(*np.asarray(points_mm).T)
        return 1 - (radius / 18.5) ** 2 if channel == "b" else np.ones(len(radius))

    def psf(self, *_, **__):
        raise PresetError("no wavefront was measured")


def test_folds_darkness_and_missing_spots_are_flagged(folder):
    figures = judge(partial(Folding, 28.0), folder)
    said = " | ".join(figures["flags"])
    assert "the g picture folds" in said
    assert "the b illumination is not positive" in said
    assert "the g illumination" not in said
    assert "no point-spread function: no wavefront was measured" in said
    assert figures["psf"] is None


def test_a_preset_is_asked_for_its_states(folder):
    asked = []

    class Preset:
        def at(self, **state):
            asked.append(state)
            return ThinLens(28.0, state["f_number"], state["focus_distance_mm"])

    judge(Preset(), folder, every=20)
    assert {s["focal_length_mm"] for s in asked} == {28.0}
    assert {s["focus_distance_mm"] for s in asked} == {CHART_MM, NEAR_MM}
    assert {s["f_number"] for s in asked} == {2.8, 3.96}
    assert len(asked) == len({tuple(s.values()) for s in asked})


def blob(shift=(0.0, 0.0), width=3.0):
    """A smooth lopsided spot on a 32 x 32 grid."""
    rows, columns = np.mgrid[:32, :32] - 15.5
    y, x = rows - shift[0], columns - shift[1]
    return np.exp(-(x**2 + y**2) / (2 * width**2)) * (1.2 + np.tanh(x / 3))


@pytest.mark.parametrize("subpixels", [1, 2, 4])
def test_a_shift_of_any_fraction_is_no_error(subpixels):
    error, shift = best_shift(blob(), blob((1.37, -0.62)), subpixels)
    assert error < 1e-5
    np.testing.assert_allclose(shift, [-1.37, 0.62], atol=1e-3)


def test_shape_is_an_error_and_scale_is_none():
    assert psf_error(blob(), 7 * blob()) < 1e-9
    wider = psf_error(blob(), blob(width=3.3))
    assert 0.05 < wider < 0.2
    assert psf_error(blob(), blob(width=3.6)) > 1.5 * wider
    assert psf_error(blob(), np.zeros((32, 32))) == 1.0
    assert psf_error(blob(), np.full((32, 32), np.nan)) == 1.0


def test_the_mirrored_distance_is_as_far_out_of_focus():
    mirrored = mirrored_distance_mm(1430.0, 2000.0)
    assert 1 / mirrored - 1 / 1430 == pytest.approx(1 / 1430 - 1 / 2000)
    assert mirrored_distance_mm(1e6, 1000.0) > 1e6

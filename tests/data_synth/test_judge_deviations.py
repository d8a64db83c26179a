"""Shares of errors within stated deviations, of lenses whose errors are drawn."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from judged_lenses import TracedLens

from data_synth.judge import judge
from data_synth.judge_deviations import covered_figures
from data_synth.judge_spots import maker_of
from data_synth.lens import set_lens
from data_synth.prescription import load_prescription
from data_synth.psf_truth import read_truth, settings_for, wavefront_truth, write_truth
from data_synth.sensor import Frame, camera_bands
from lensfit.errors import LensfitError

FRAME = Frame((240, 180), (24.0, 18.0))
BANDS = camera_bands(3)
CHART_MM = 1120.0
BARREL, TURN = 4e-4, np.array([2e-4, -1e-4])
"""Of the division model (per squared mm), and of a homography (per mm)."""
NOISE, OF_PEAK = 1e-3, 0.05
"""Millimetres and light; light of a pixel against the peak, to which the tracer draws a
spot of few pixels within .005."""


def traced(f_number, focus_mm):
    lens = load_prescription("nikkor_28")
    return set_lens(lens, f_number=f_number, focus_distance_mm=focus_mm)


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truth")
    settings = settings_for(((2.8, CHART_MM, CHART_MM),))
    write_truth(folder, wavefront_truth(traced, FRAME, BANDS, settings, 28.0))
    return read_truth(folder)


@dataclass(frozen=True, eq=False)
class Unsure(TracedLens):
    """The tracer with errors of a size, which it states `honesty` times as large, on a
    map with a tenth of barrel and through a camera that is turned a little."""

    honesty: float = 1.0

    def _noise(self, shape, seed):
        return NOISE * np.random.default_rng(seed).normal(size=shape)

    def project(self, object_points_mm, channel="g"):
        place = super().project(object_points_mm, channel)
        turned = self.undistorted_from_distorted(place)
        turned = turned / (1 + turned @ TURN)[:, None]
        place = self.distorted_from_undistorted(turned)
        return place + self._noise(place.shape, "rgb".index(channel))

    def relative_illumination(self, points_mm, channel="g"):
        light = super().relative_illumination(points_mm, channel)
        away = np.hypot(*np.asarray(points_mm).T) > 0.5
        return light + away * self._noise(light.shape, 5)

    def undistorted_from_distorted(self, points_mm):
        points = np.asarray(points_mm)
        return points / (1 - BARREL * np.sum(points**2, -1, keepdims=True))

    def distorted_from_undistorted(self, points_mm):
        points = np.asarray(points_mm)
        squared = np.sum(points**2, -1, keepdims=True)
        return points * 2 / (1 + np.sqrt(1 + 4 * BARREL * squared))

    def position_standard_deviation_mm(self, points_mm):
        return np.full((len(points_mm), 2), self.honesty * NOISE)

    def lateral_colour_standard_deviation_mm(self, points_mm, channel):
        return np.full((len(points_mm), 2), self.honesty * NOISE * np.sqrt(2))

    def illumination_standard_deviation(self, points_mm):
        return np.full(len(points_mm), self.honesty * NOISE)

    def known_psfs(self, image_points_mm, object_distance_mm, channel, **raster):
        raster = {key: raster[key] for key in ("pixel_pitch_mm", "size_px")}
        exact = np.array(
            [
                self.psf(point, object_distance_mm, channel, **raster)
                for point in image_points_mm
            ]
        )
        peak = exact.max((1, 2), keepdims=True)
        size = OF_PEAK * peak * np.ones_like(exact)
        noise = size * self._noise(exact.shape, 7) / NOISE
        return SimpleNamespace(psf=exact + noise, deviation=self.honesty * size)


@pytest.mark.slow
@pytest.mark.parametrize(("honesty", "expected"), [(1.0, 68.3), (0.5, 38.3), (9, 100)])
def test_shares_are_those_of_a_normal_error(truth, honesty, expected):
    def make(f_number, focus_mm):
        return Unsure(traced(f_number, focus_mm), BANDS, CHART_MM, honesty)

    found = covered_figures(make, truth)
    assert set(found) == {"chief_rays", "lateral_colour", "fall_off", "psf"}
    for name, share in found.items():
        few = 18 if name == "psf" else 9
        assert share == pytest.approx(expected, abs=few), name


@pytest.mark.slow
def test_what_a_lens_does_not_say_is_left_out(truth, tmp_path):
    def silent(f_number, focus_mm):
        return TracedLens(traced(f_number, focus_mm), BANDS, CHART_MM)

    assert covered_figures(silent, truth) == {}

    class Half(Unsure):
        def illumination_standard_deviation(self, points_mm):
            raise LensfitError("nobody knows")

    def half(f_number, focus_mm):
        return Half(traced(f_number, focus_mm), BANDS, CHART_MM)

    assert set(covered_figures(half, truth)) == {"chief_rays", "lateral_colour", "psf"}
    write_truth(tmp_path, truth)
    assert judge(half, tmp_path, every=9)["covered"] == covered_figures(
        maker_of(half, truth), truth
    )

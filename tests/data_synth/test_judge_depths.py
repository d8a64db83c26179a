"""Chief rays where a lens is focused: exact ones are right, and a wrong pupil shows."""

import json

import numpy as np
import pytest

from data_synth.aim import chief_landings_mm, tracer_from_object
from data_synth.judge_depths import depth_figures, frame_errors, settings_in
from data_synth.lens import set_lens
from data_synth.prescription import load_prescription
from data_synth.sensor import Sensor, camera_bands
from data_synth.shoot import Camera, lens_truth
from data_synth.wavefront_cases import frame_for
from lensfit.errors import LensfitError

FOCUS_MM = (800.0, 2000.0)
SIGMA_MM = 1e-3


class Traced:
    """The tracer itself, off by random errors of a stated size."""

    def __init__(self, focus_mm: float, sigma_mm: float, known: bool = True):
        design = load_prescription("nikkor_28")
        self.lens = set_lens(design, f_number=8.0, focus_distance_mm=focus_mm)
        self.sigma_mm, self.known = sigma_mm, known

    def project(self, object_points_mm, channel="g"):
        band = camera_bands(3)["rgb".index(channel)]
        points = tracer_from_object(np.asarray(object_points_mm))
        landed = sum(
            share * chief_landings_mm(self.lens, points, nm)
            for nm, share in zip(band.wavelengths_nm, band.weights, strict=True)
        )
        noise = np.random.default_rng(0).normal(0, 1, (len(points), 2))
        return np.asarray(landed) + self.sigma_mm * noise

    def object_standard_deviation_mm(self, object_points_mm):
        if not self.known:
            raise LensfitError("nobody knows")
        return np.full((len(object_points_mm), 2), self.sigma_mm)


@pytest.fixture(scope="module")
def frame():
    return frame_for(load_prescription("nikkor_28"), (640, 480))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, frame):
    """What a shoot writes of its lens."""
    design = load_prescription("nikkor_28")
    states = {
        f"28.00mm_f{n:g}_{mm:g}mm": set_lens(design, f_number=n, focus_distance_mm=mm)
        for n in (8.0, 4.0)
        for mm in FOCUS_MM
    }
    made = tmp_path_factory.mktemp("shoot")
    table = lens_truth(design, Camera(frame, Sensor()), states)
    (made / "truth_lens.json").write_text(json.dumps(table))
    return made


def test_every_focus_distance_is_judged_at_its_widest_stop(folder, frame):
    settings = list(settings_in(folder, frame))
    assert [(s.f_number, s.focus_mm) for s in settings] == [
        (4.0, mm) for mm in FOCUS_MM
    ]
    for setting in settings:
        assert (setting.object_mm[:, 2] == setting.focus_mm).all()


def test_the_tracer_is_right_and_errors_are_counted(folder, frame):
    exact = depth_figures(lambda _, mm: Traced(mm, 0.0), folder, frame)
    assert max(exact["chief_ray_at_focus_px"].values()) < 2e-3
    assert max(exact["lateral_colour_at_focus_px"]["800"].values()) < 2e-3
    off = depth_figures(lambda _, mm: Traced(mm, SIGMA_MM), folder, frame)
    expected_px = 2**0.5 * SIGMA_MM / frame.pitch_mm[0]
    for px in off["chief_ray_at_focus_px"].values():
        assert px == pytest.approx(expected_px, rel=0.15)
    for percent in off["covered_at_focus"].values():
        assert percent == pytest.approx(68.0, abs=8.0)


def test_an_error_of_the_scale_is_told_from_one_of_the_corners(folder, frame):
    exact = frame_errors(lambda _, mm: Traced(mm, 0.0), folder, frame)
    assert max(exact) < 5e-3

    class Larger(Traced):
        def project(self, object_points_mm, channel="g"):
            return 1.002 * super().project(object_points_mm, channel)

    larger = frame_errors(lambda _, mm: Larger(mm, 0.0), folder, frame)
    half_diagonal_px = np.hypot(*frame.size_px) / 2
    assert larger.scale_px == pytest.approx(0.002 * half_diagonal_px, rel=0.15)
    assert larger.corner_px < 5e-3
    off = frame_errors(lambda _, mm: Traced(mm, SIGMA_MM), folder, frame)
    expected_px = 2**0.5 * SIGMA_MM / frame.pitch_mm[0]
    assert off.corner_px == pytest.approx(expected_px, rel=0.4)


def test_a_lens_of_another_focus_is_seen(folder, frame):
    """Its entrance pupil is elsewhere, and its picture as much larger."""
    found = depth_figures(lambda _, __: Traced(500.0, 0.0), folder, frame)
    right = depth_figures(lambda _, mm: Traced(mm, 0.0), folder, frame)
    for key, px in found["chief_ray_at_focus_px"].items():
        assert px > 3 * right["chief_ray_at_focus_px"][key]


def test_what_nobody_states_or_traced_is_left_out(folder, frame, tmp_path):
    silent = depth_figures(lambda _, mm: Traced(mm, 0.0, known=False), folder, frame)
    assert silent["covered_at_focus"] == {}
    assert depth_figures(lambda _, mm: Traced(mm, 0.0), tmp_path, frame) == {}

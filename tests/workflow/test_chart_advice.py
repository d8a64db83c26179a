"""Advice on charts agrees with an exact ray trace of a published lens."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from data_synth.chart import Chart, Pose
from data_synth.dots import expose_dots
from data_synth.lens import set_lens
from data_synth.prescription import load_prescription
from data_synth.sensor import camera_bands
from data_synth.wavefront_cases import frame_for
from lensfit.chart.chart_camera import Camera, blur_mm, magnification_at
from lensfit.chart.coverage import paint
from lensfit.chart.drawing import BLACK, WHITE, Drawing, Layer
from lensfit.chart.layout import Wanted
from lensfit.chart.sheet import paper_sheet
from lensfit.detect.dots import find_dots
from lensfit.errors import ChartError
from lensfit.photograph import Photograph
from lensfit.workflow.chart import advise

DISTANCE_MM = 1500.0


@pytest.fixture(scope="module")
def prescription():
    return load_prescription("biotar_50")


def traced(prescription, f_number, focus_mm, chart, size_px):
    """Second moments of dots near the middle in green, and how many are seen."""
    frame = frame_for(prescription, size_px)
    lens = set_lens(
        prescription, f_number=f_number, focus_distance_mm=focus_mm, blades=0
    )
    image, dots = expose_dots(
        lens, chart, Pose(DISTANCE_MM), frame, camera_bands(1),
        rays_per_wavelength=512,
    )  # fmt: skip
    chief = dots.chief_px[1]
    inside = ((chief > 0) & (chief < size_px)).all(1)
    return frame, lens, image[..., 1], chief[inside]


def diameter_px(image, centre, half):
    x0, y0 = (int(c) - half for c in centre)
    window = image[y0 : y0 + 2 * half + 1, x0 : x0 + 2 * half + 1]
    grid = np.arange(2 * half + 1) + 0.5
    total = window.sum()
    x, y = window.sum(0) @ grid / total, window.sum(1) @ grid / total
    xx = window.sum(0) @ (grid - x) ** 2 / total - 1 / 12
    yy = window.sum(1) @ (grid - y) ** 2 / total - 1 / 12
    return 4 * np.sqrt((xx + yy) / 2)


def test_dots_on_the_frame_and_their_size(prescription):
    size_px = (480, 320)
    frame = frame_for(prescription, size_px)
    sheet = paper_sheet("1300x1024")
    focal = set_lens(prescription, f_number=5.6, focus_distance_mm=DISTANCE_MM)
    camera = Camera(focal.focal_length_mm, 5.6, frame.size_mm[0], size_px)
    advice = advise(camera, Wanted("dot-grid", 24.0, 10.0), sheet, DISTANCE_MM)
    chart = Chart("dot-grid", 24.0, 10.0)
    _, _, image, chief = traced(prescription, 5.6, DISTANCE_MM, chart, size_px)
    # four are missing for orientation
    assert advice.marks_on_frame + 4 == pytest.approx(len(chief), rel=0.05)
    middle = chief[np.argmin(np.linalg.norm(chief - np.array(size_px) / 2, axis=1))]
    half = int(advice.pitch_px / 2)
    assert advice.mark_px == pytest.approx(diameter_px(image, middle, half), rel=0.05)


@pytest.mark.parametrize("name", ["nearer", "farther"])
def test_blur_on_both_sides_of_focus(prescription, name):
    size_px = (480, 320)
    frame = frame_for(prescription, size_px)
    lens = set_lens(prescription, f_number=2.8, focus_distance_mm=DISTANCE_MM)
    camera = Camera(lens.focal_length_mm, 2.8, frame.size_mm[0], size_px)
    wanted = Wanted("dot-grid", 150.0, 1.0)
    advice = advise(camera, wanted, paper_sheet("2000x1400"), DISTANCE_MM)
    take = next(t for t in advice.takes if t.name == name and t.f_number == 2.8)
    chart = Chart("dot-grid", 150.0, 1.0)
    _, _, image, chief = traced(
        prescription, 2.8, take.focus_distance_mm, chart, size_px
    )
    middle = chief[np.argmin(np.linalg.norm(chief - np.array(size_px) / 2, axis=1))]
    blur = diameter_px(image, middle, int(advice.pitch_px / 2))
    assert take.blur_px == pytest.approx(blur, rel=0.1)
    assert not take.overlapping


def test_formulas_at_their_limits():
    # life size at four focal lengths; no blur in focus; the circle grows as 1/N
    assert magnification_at(50.0, 200.0) == pytest.approx(1.0)
    assert magnification_at(50.0, 1e7) == pytest.approx(50 / 1e7, rel=1e-4)
    assert blur_mm(50.0, 2.0, 2000.0, 2000.0) == pytest.approx(0, abs=1e-12)
    wide, narrow = (blur_mm(50.0, n, 1800.0, 2000.0) for n in (1.4, 2.8))
    assert wide == pytest.approx(2 * narrow)


def test_the_distance_advised_fills_the_frame():
    camera = Camera(50.0, 2.0, 36.0, (6000, 4000))
    advice = advise(camera, Wanted(), paper_sheet("A2"))
    extent = np.array([advice.columns - 1, advice.rows - 1]) * advice.pitch_mm
    cover = extent / advice.field_mm
    assert cover.min() == pytest.approx(1.0)
    chosen = advise(camera, Wanted(), None, advice.distance_mm * 0.98)
    assert sorted(chosen.sheet_mm) == [420.0, 594.0]


def test_dots_that_overlap_are_told():
    camera = Camera(50.0, 1.4, 36.0, (6000, 4000))
    advice = advise(camera, Wanted("dot-grid", 10.0, 7.0), paper_sheet("A3"))
    assert any(take.overlapping for take in advice.takes)
    assert not advice.takes[0].overlapping


def test_what_cannot_be_in_focus_is_refused():
    camera = Camera(50.0, 2.0, 36.0, (6000, 4000))
    for distance in (0.0, 150.0, float("inf"), float("nan")):
        with pytest.raises(ChartError, match="focus"):
            advise(camera, Wanted(), paper_sheet("A3"), distance)


@pytest.mark.parametrize("polarity", ["bright", "dark"])
@pytest.mark.parametrize("dot_px", [5.0, 14.0])
def test_scatter_is_what_the_detector_says_of_itself(polarity, dot_px):
    pitch_px, columns, rows, noise = 50.0, 16, 12, 0.005
    size_px = (round(pitch_px * columns), round(pitch_px * rows))
    j, i = np.mgrid[:rows, :columns]
    centre = np.stack([i.ravel() + 0.5, j.ravel() + 0.47], -1) * pitch_px
    discs = np.column_stack([centre, np.full(len(centre), dot_px / 2)])
    ink, ground = (WHITE, BLACK) if polarity == "bright" else (BLACK, WHITE)
    drawing = Drawing(*size_px, ground, (Layer(ink, discs_mm=discs),), "")
    image = gaussian_filter(paint(drawing, 1.0), 0.8)
    image = 0.01 + image + noise * np.random.default_rng(0).normal(size=image.shape)
    photograph = Photograph(image.astype(np.float32)[..., None], Path("x.exr"), "")
    found = find_dots(photograph, polarity=polarity)
    told = np.sqrt(np.median(found.covariance_px2[:, 0, 0]))
    # a lens and a sensor under which the same chart has the same pixels
    camera = Camera(50.0, 8.0, 10.0, size_px, 100 * noise)
    per_mm = magnification_at(50.0, 2000.0) / camera.pixel_mm
    wanted = Wanted("dot-grid", pitch_px / per_mm, dot_px / per_mm, polarity)
    advice = advise(camera, wanted, paper_sheet("1000x800"), 2000.0)
    assert advice.mark_px == pytest.approx(dot_px, rel=1e-3)
    assert advice.scatter_px == pytest.approx(told, rel=0.3)

"""Predictions through focus and aperture: what is chosen, where, and how wide it is."""

import cv2
import numpy as np
import pytest
from test_report_blur import entry_of, report_of, saved

from lensfit.report.kernels import SIZE_PX
from lensfit.report.report_page import write_report
from lensfit.report.through import (
    DISTANCES,
    HEIGHTS,
    defocus_of,
    f_numbers_of,
    through_sheets,
)


@pytest.mark.parametrize(
    ("photographed", "shown"),
    [
        ([1.4], (1.4, 2.0, 2.8, 4.0)),
        ([1.4, 2.8], (1.4, 2.0, 2.8, 4.0)),
        ([4.5, 2.05], (2.05, 2.8, 4.5, 5.6)),
        ([1.4, 2.0, 2.8, 4.0, 5.6, 8.0], (1.4, 2.8, 4.0, 8.0)),
        ([40.0], (40.0,)),
    ],
)
def test_stops_are_those_photographed_and_full_ones_beyond(photographed, shown):
    assert f_numbers_of(photographed) == shown


def test_defocus_holds_what_was_photographed_and_goes_beyond():
    values = defocus_of([2e-4, 0.0, -1e-4], 1e-4, -5e-4)
    assert len(values) == DISTANCES
    assert list(values) == sorted(values)
    assert {2e-4, 0.0, -1e-4} <= set(values)
    assert values[0] == pytest.approx(-1.5e-4)
    assert values[-1] == pytest.approx(3e-4)


def test_defocus_ends_at_infinity_and_has_both_sides_if_one_was_photographed():
    values = defocus_of([-4e-4], 1e-4, -5e-4)
    assert values[0] == -5e-4
    assert 0.0 in values
    assert values[-1] == pytest.approx(1e-4)


def test_many_photographed_ones_are_thinned_but_never_at_the_ends():
    photographed = np.linspace(-1e-4, 3e-4, 23).tolist()
    values = defocus_of(photographed, 1e-4, -1.0)
    assert len(values) == DISTANCES
    assert {photographed[0], photographed[-1]} <= set(values)


@pytest.fixture(scope="module")
def sheet(tmp_path_factory):
    """An ideal 50 mm, chart at 1 m, focused on it at f/1.4 and farther at f/2.8."""
    folder = tmp_path_factory.mktemp("through")
    preset = saved(folder, entry_of(1000.0, ()), entry_of(4000.0, ()))
    (found,) = through_sheets(
        report_of((1000.0, 1.4, 1000.0), (4000.0, 2.8, 1000.0)), preset
    )
    return found


def test_what_was_photographed_is_framed_at_its_own_defocus(sheet):
    """Focused at 4 m the chart at 1 m is 0.8 dioptres off, measured from the pupil."""
    assert sheet.focus_distance_mm == 1000.0
    framed = {
        (sheet.f_numbers[row], column)
        for row, column in np.argwhere(sheet.photographed)
    }
    distances = np.array(sheet.distances_mm)
    in_focus = int(np.argmin(np.abs(distances - 1000)))
    pupil = 51.3
    near = 1 / (2 / (1000 - pupil) - 1 / (4000 - pupil)) + pupil
    beside = int(np.argmin(np.abs(distances - near)))
    assert distances[beside] == pytest.approx(near, rel=1e-3)
    assert framed == {(1.4, in_focus), (2.8, beside)}
    assert (np.diff(distances) < 0).all()


def test_blur_grows_with_defocus_and_shrinks_with_the_stop(sheet):
    assert len(sheet.pictures) == len(HEIGHTS)
    picture = cv2.imdecode(np.frombuffer(sheet.pictures[0], np.uint8), 0)
    assert picture is not None
    step = SIZE_PX + 2
    lit = np.array(
        [
            [
                np.sum(
                    picture[
                        2 + r * step : r * step + step, 2 + c * step : (c + 1) * step
                    ]
                    > 60
                )
                for c in range(DISTANCES)
            ]
            for r in range(len(sheet.f_numbers))
        ]
    )
    in_focus = int(np.argmin(np.abs(np.array(sheet.distances_mm) - 1000)))
    assert (np.diff(lit[0, in_focus:]) > 0).all()
    assert (np.diff(lit[:, -1]) < 0).all()
    ratio = lit[0, -1] / lit[2, -1]
    assert ratio == pytest.approx((2.8 / 1.4) ** 2, rel=0.25)


def test_the_page_shows_the_three_places(tmp_path):
    report = report_of((2000.0, 2.8, 1000.0))
    saved(tmp_path, entry_of(2000.0, ()))
    html = write_report(report, tmp_path).read_text(encoding="utf-8")
    assert html.count('data-figure="through"') == len(HEIGHTS)
    for text in (*HEIGHTS, "f/2.8", "f/5.6", 'class="shown"'):
        assert text in html


def test_a_lens_without_measured_blur_is_predicted_nothing(tmp_path):
    report = report_of((2000.0, 2.8, 1000.0))
    assert through_sheets(report, tmp_path / "preset.json") == []
    report["blur"] = []
    assert through_sheets(report, saved(tmp_path, entry_of(2000.0, ()))) == []

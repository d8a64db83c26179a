"""Charts are read back from photographs: what they are, and which mark is which."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from chart_scene import a4, error_px, photographed

from lensfit.chart.pattern import BASE, Pattern, dictionary
from lensfit.detect import chart_code
from lensfit.detect.chart_code import read_chart_code
from lensfit.detect.find import observe
from lensfit.detect.orientation import numbered_as_on_chart
from lensfit.photograph import Photograph

STANDINGS = [
    ("dot-grid", "bright", 0, 0.0),
    ("dot-grid", "bright", 90, 0.0),
    ("dot-grid", "dark", 180, 0.0),
    ("dot-grid", "dark", 33, 0.15),
    ("line-grid", "bright", 180, 0.0),
    ("line-grid", "dark", 270, 0.15),
    ("checkerboard", None, 90, 0.0),
    ("checkerboard", None, 184, 0.15),
]


@pytest.mark.parametrize(("kind", "polarity", "turn", "tilt"), STANDINGS)
def test_code_and_numbers_are_read_however_the_chart_stands(kind, polarity, turn, tilt):
    layout = a4(kind, polarity)
    photograph, homography = photographed(layout, turn_deg=turn, tilt=tilt)
    assert read_chart_code(photograph) == layout.pattern
    found = observe(photograph, kind)
    marks = numbered_as_on_chart(photograph, found, layout.pattern)
    assert marks is not None
    assert len(marks) > 0.9 * len(found)
    assert error_px(marks, layout, homography).max() < 0.25


@pytest.mark.parametrize("size_px", [(1200, 900), (2400, 1800), (4800, 3600)])
def test_the_code_is_read_from_light_through_cut_foil(size_px):
    layout = a4("dot-grid", "bright")
    photograph, _ = photographed(layout, cut=True, size_px=size_px, turn_deg=33)
    assert read_chart_code(photograph) == layout.pattern


def test_marks_are_numbered_out_of_focus_too():
    layout = a4("dot-grid")
    photograph, homography = photographed(layout, turn_deg=180, blur_px=6.0)
    assert read_chart_code(photograph) is None
    found = observe(photograph, "dot-grid", polarity="bright")
    marks = numbered_as_on_chart(photograph, found, layout.pattern)
    assert marks is not None
    assert error_px(marks, layout, homography).max() < 0.5


def test_all_dots_but_the_missing_ones_are_found():
    layout = a4("dot-grid")
    photograph, _ = photographed(layout)
    found = observe(photograph, "dot-grid")
    columns, rows = layout.pattern.lattice_size
    assert len(found) == columns * rows - 4


def test_part_of_a_chart_is_numbered_by_the_whole_chart():
    layout = a4("dot-grid")
    photograph, homography = photographed(layout, turn_deg=90, fill=1.7)
    found = observe(photograph, "dot-grid")
    assert len(found) < 0.8 * (layout.pattern.columns * layout.pattern.rows)
    marks = numbered_as_on_chart(photograph, found, layout.pattern)
    assert marks is not None
    assert error_px(marks, layout, homography).max() < 0.25


def test_a_mirrored_photograph_is_not_numbered():
    layout = a4("dot-grid")
    photograph, _ = photographed(layout)
    mirrored = Photograph(
        np.ascontiguousarray(photograph.pixels[:, ::-1]), photograph.path, ""
    )
    found = observe(mirrored, "dot-grid")
    assert numbered_as_on_chart(mirrored, found, layout.pattern) is None
    assert read_chart_code(mirrored) is None


def test_another_grid_without_orientation_marks_is_left_as_it_is():
    layout = a4("dot-grid")
    whole = Pattern(
        "dot-grid", "bright", 14.0, 3.5, *layout.pattern.lattice_size, False
    )
    photograph, _ = photographed(layout)
    found = observe(photograph, "dot-grid")
    assert numbered_as_on_chart(photograph, found, whole) is None


def test_a_mark_that_looks_like_one_marker_is_not_worth_an_enlarged_picture(
    monkeypatch,
):
    marker = cv2.aruco.generateImageMarker(dictionary(), 9 * BASE + 5, 60)
    pixels = np.pad(marker, 200, constant_values=255)[..., None] / np.float32(255)
    scales = []
    look = chart_code._look
    monkeypatch.setattr(
        chart_code,
        "_look",
        lambda picture, scale, seen: (scales.append(scale), look(picture, scale, seen)),
    )
    assert read_chart_code(Photograph(pixels, Path("one.exr"), "")) is None
    assert scales == [1.0]


def test_nothing_is_read_where_there_is_no_chart():
    noise = np.random.default_rng(1).random((300, 400, 1)).astype(np.float32)
    for pixels in (noise, np.zeros_like(noise), np.full_like(noise, np.nan)):
        assert read_chart_code(Photograph(pixels, Path("no.exr"), "")) is None

"""Pixels hold the area that is covered: exactly, wherever an edge lies."""

import numpy as np
import pytest

from lensfit.chart.coverage import disc_area, paint
from lensfit.chart.drawing import BLACK, WHITE, Drawing, Layer
from lensfit.chart.layout import text_outline, width_per_em


def drawing(*layers: Layer) -> Drawing:
    return Drawing(20.0, 16.0, BLACK, layers, "test")


def test_a_disc_covers_its_area_at_every_resolution():
    disc = np.array([[7.3, 8.1, 4.7]])
    for pixel_mm in (1.0, 0.37, 8.0):
        picture = paint(drawing(Layer(WHITE, discs_mm=disc)), pixel_mm).astype(float)
        assert picture.sum() * pixel_mm**2 == pytest.approx(np.pi * 4.7**2, rel=1e-6)


def test_a_disc_agrees_with_counting_fine_samples():
    disc = np.array([[2.6, 2.2, 1.9]])
    picture = paint(Drawing(5.0, 5.0, BLACK, (Layer(WHITE, discs_mm=disc),), ""), 1.0)
    fine = (np.arange(5 * 400) + 0.5) / 400
    inside = np.hypot(fine - 2.6, fine[:, None] - 2.2) <= 1.9
    counted = inside.reshape(5, 400, 5, 400).mean((1, 3))
    np.testing.assert_allclose(picture, counted, atol=2e-4)


def test_the_area_left_of_and_above_a_point_at_its_limits():
    far, zero = np.array(9.0), np.array(0.0)
    assert disc_area(far, far, 2.0) == pytest.approx(4 * np.pi)
    assert disc_area(zero, far, 2.0) == pytest.approx(2 * np.pi)
    assert disc_area(zero, zero, 2.0) == pytest.approx(np.pi)
    assert disc_area(far, -far, 2.0) == pytest.approx(0, abs=1e-12)


def test_boxes_and_crossing_lines_are_exact():
    upright = np.array([[3.25, 0.0, 0.5, 16.0]])
    level = np.array([[0.0, 5.5, 20.0, 0.75]])
    picture = paint(
        drawing(Layer(WHITE, boxes_mm=upright), Layer(WHITE, boxes_mm=level)), 1.0
    )
    assert picture[0, 3] == pytest.approx(0.5)
    assert picture[5, 0] == pytest.approx(0.5)
    assert picture[6, 0] == pytest.approx(0.25)
    assert picture[5, 3] == pytest.approx(1 - 0.5 * 0.5)


def test_letters_cover_the_same_area_at_every_resolution():
    outline = text_outline("O8mm", 2.0, 11.0, 5.0)
    areas = [
        float(paint(drawing(Layer(WHITE, outlines=(outline,))), p).sum()) * p**2
        for p in (0.05, 0.5)
    ]
    assert areas[1] == pytest.approx(areas[0], rel=2e-3)
    fine = paint(drawing(Layer(WHITE, outlines=(outline,))), 0.05)
    assert fine.max() == pytest.approx(1, abs=1e-5)
    columns = np.flatnonzero(fine.any(0)) * 0.05
    width = columns[-1] - columns[0]
    assert width == pytest.approx(5 * width_per_em("O8mm"), rel=0.06)
    # an O and the loops of an 8 are holes: lit pixels start and stop several times
    middle = fine[int(9.2 / 0.05)] > 0.5
    assert np.count_nonzero(np.diff(middle.astype(int)) == 1) >= 4
